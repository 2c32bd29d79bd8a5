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

FMFTS_FUNCTION(follow_finger)
{
    enum { PARAMETERS, MEMORY, FIELD, SAMPLED };
    long long sequence, time_us;
    unsigned int fresh;
    fmfts_now now;
    if (!PyArg_ParseTuple(args, "y*w*y*y*ILL", &b[PARAMETERS], &b[MEMORY], &b[FIELD], &b[SAMPLED], &fresh, &sequence, &time_us) ||
        !is_of_a_pad(&b[PARAMETERS], &b[MEMORY]) || !fmfts_are_possible(sequence, time_us, 0)) {
        return NULL;
    }
    const fmfts_parameters *parameters = b[PARAMETERS].buf;
    const size_t sensors = (size_t)parameters->pose.sensors;
    if (!fmfts_has_doubles(&b[FIELD], 3 * sensors, "field") ||
        !fmfts_has_size(&b[SAMPLED], sensors * sizeof(int64_t), "sampled")) {
        return NULL;
    }
    const fmfts_finger_frame frame = {sequence, time_us, fresh, b[FIELD].buf, b[SAMPLED].buf};
    fmfts_follow_finger(parameters, b[MEMORY].buf, &frame, &now);
    return told(&now);
}

FMFTS_FUNCTION(follow_finger_early)
{
    enum { PARAMETERS, MEMORY };
    long long time_us;
    int sensor;
    unsigned int gain_code;
    int16_t counts[3];
    fmfts_now now;
    if (!PyArg_ParseTuple(args, "y*w*iIhhhL", &b[PARAMETERS], &b[MEMORY], &sensor, &gain_code, &counts[0], &counts[1], &counts[2],
                          &time_us) ||
        !is_of_a_pad(&b[PARAMETERS], &b[MEMORY]) || !fmfts_are_possible(0, time_us, 0)) {
        return NULL;
    }
    const fmfts_parameters *parameters = b[PARAMETERS].buf;
    fmfts_early early = {.sensor = sensor, .time_us = time_us};
    fmfts_read_early(&parameters->pose, gain_code, counts, early.field_t);
    fmfts_follow_finger_early(parameters, b[MEMORY].buf, &early, &now);
    return told(&now);
}
