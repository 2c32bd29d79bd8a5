/* `now` of a pad with several magnets for Python: finger.c, on what Python judged of the frame. */
#include "_pad.h"
#include "finger.h"

static bool is_of_a_pad(const Py_buffer *parameters, const Py_buffer *memory)
{
    if (!fmfts_has_size(parameters, sizeof(fmfts_parameters), "parameters") ||
        !fmfts_has_size(memory, sizeof(fmfts_followed_memory), "memory")) {
        return false;
    }
    double sensors = ((const fmfts_parameters *)parameters->buf)->pose.sensors;
    if (!(sensors >= 1.0 && sensors <= FMFTS_SENSORS)) {
        PyErr_Format(PyExc_ValueError, "parameters: a pad has 1 to %d sensors", FMFTS_SENSORS);
        return false;
    }
    return true;
}

/* The time that `now` is about on the board's clock, whether it tells places, and x, y, force with deviation, rate and its deviation
 * each; None: unknown. */
static PyObject *told(const fmfts_now *now)
{
    const fmfts_contact_now *c = &now->contact;
    if (!now->known) {
        return Py_NewRef(Py_None);
    }
    return Py_BuildValue("(LN(dddd)(dddd)(dddd))", (long long)now->time_us, PyBool_FromLong(now->places), c->value[0],
                         c->deviation[0], c->rate[0], c->rate_deviation[0], c->value[1], c->deviation[1], c->rate[1],
                         c->rate_deviation[1], c->value[2], c->deviation[2], c->rate[2], c->rate_deviation[2]);
}

PyObject *fmfts_py_follow_finger(PyObject *module, PyObject *args)
{
    enum { PARAMETERS, MEMORY, FIELD, SAMPLED, BUFFERS };
    Py_buffer b[BUFFERS] = {{0}};
    long long sequence, time_us;
    unsigned int fresh;
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "y*w*y*y*ILL", &b[PARAMETERS], &b[MEMORY], &b[FIELD], &b[SAMPLED], &fresh, &sequence, &time_us) &&
        is_of_a_pad(&b[PARAMETERS], &b[MEMORY])) {
        const fmfts_parameters *parameters = b[PARAMETERS].buf;
        size_t sensors = (size_t)parameters->pose.sensors;
        if (fmfts_has_size(&b[FIELD], 3 * sensors * sizeof(double), "field") &&
            fmfts_has_size(&b[SAMPLED], sensors * sizeof(int64_t), "sampled")) {
            const fmfts_finger_frame frame = {sequence, time_us, fresh, b[FIELD].buf, b[SAMPLED].buf};
            fmfts_now now;
            fmfts_follow_finger(parameters, b[MEMORY].buf, &frame, &now);
            result = told(&now);
        }
    }
    fmfts_give_back(b, BUFFERS);
    return result;
}

PyObject *fmfts_py_follow_finger_early(PyObject *module, PyObject *args)
{
    enum { PARAMETERS, MEMORY, BUFFERS };
    Py_buffer b[BUFFERS] = {{0}};
    long long time_us;
    int sensor;
    unsigned int gain_code;
    int16_t counts[3];
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "y*w*iIhhhL", &b[PARAMETERS], &b[MEMORY], &sensor, &gain_code, &counts[0], &counts[1], &counts[2],
                         &time_us) &&
        is_of_a_pad(&b[PARAMETERS], &b[MEMORY])) {
        const fmfts_parameters *parameters = b[PARAMETERS].buf;
        fmfts_early early = {.sensor = sensor, .time_us = time_us};
        fmfts_now now;
        fmfts_read_early(&parameters->pose, gain_code, counts, early.field_t);
        fmfts_follow_finger_early(parameters, b[MEMORY].buf, &early, &now);
        result = told(&now);
    }
    fmfts_give_back(b, BUFFERS);
    return result;
}
