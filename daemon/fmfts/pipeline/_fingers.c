/* Messages of a pad with several magnets: methods of Pad for several_pipeline.py, which judges the frames. */
#include "_pad.h"

#include <math.h>
#include <string.h>

#include "../pose/push.h"
#include "steps.h"

enum { ARRAYS = 16 };

/* The arrays of one call. fits: whether all had the size that they need. */
typedef struct {
    Py_buffer array[ARRAYS];
    int count;
    bool fits;
} arrays;

static void give_back(arrays *given)
{
    for (int i = 0; i < given->count; i++) {
        PyBuffer_Release(&given->array[i]);
    }
}

/* The next array, of so many bytes; NULL with an exception if it does not fit. */
static void *next_of(arrays *given, PyObject *object, int how, size_t bytes, const char *what)
{
    Py_buffer *array = &given->array[given->count];
    if (!given->fits) {
        return NULL;
    }
    if (PyObject_GetBuffer(object, array, how) < 0) {
        given->fits = false;
        return NULL;
    }
    given->count++;
    given->fits = fmfts_has_bytes(array, bytes, sizeof(double), what);
    return given->fits ? array->buf : NULL;
}

static double *doubles_of(arrays *given, PyObject *object, size_t count, const char *what)
{
    return next_of(given, object, PyBUF_SIMPLE, count * sizeof(double), what);
}

static double *doubles_or_none(arrays *given, PyObject *object, size_t count, const char *what)
{
    return object == Py_None ? NULL : doubles_of(given, object, count, what);
}

static bool is_tuple(PyObject *object)
{
    if (!PyTuple_Check(object)) {
        PyErr_SetString(PyExc_TypeError, "fingers and magnets are tuples, or None");
    }
    return PyTuple_Check(object);
}

/* fingers: over_range, ids, and the arrays of fmfts_fingers_found. */
static bool take_fingers(arrays *given, PyObject *fingers, fmfts_fingers_found *found, int *over_range)
{
    PyObject *ids, *finger, *covariance, *shear, *shear_deviation, *least;
    if (!is_tuple(fingers) || !PyArg_ParseTuple(fingers, "pO!OOOOO", over_range, &PyTuple_Type, &ids, &finger, &covariance,
                                                &shear, &shear_deviation, &least)) {
        return false;
    }
    size_t count = found->count = (size_t)PyTuple_Size(ids), unknowns = FMFTS_FINGER_NUMBERS * count;
    if (count > FMFTS_TOLD_FINGERS) {
        PyErr_Format(PyExc_ValueError, "%zu fingers, at most %d", count, FMFTS_TOLD_FINGERS);
        return false;
    }
    for (size_t f = 0; f < count; f++) {
        found->id[f] = PyLong_AsLongLong(PyTuple_GetItem(ids, (Py_ssize_t)f));
    }
    found->finger = doubles_of(given, finger, unknowns, "fingers");
    found->covariance = doubles_of(given, covariance, unknowns * unknowns, "covariance");
    found->shear_n = doubles_of(given, shear, 2 * count, "shear");
    found->shear_deviation_n = doubles_of(given, shear_deviation, 2 * count, "deviation of the shear");
    found->least = doubles_or_none(given, least, FMFTS_FINGER_NUMBERS + unknowns, "least variance");
    return given->fits && !PyErr_Occurred();
}

static bool take_magnets(arrays *given, PyObject *tuple, size_t magnets, size_t axes, fmfts_magnets_found *found)
{
    PyObject *position, *axis, *variance, *misfit, *ambient;
    if (!is_tuple(tuple) || !PyArg_ParseTuple(tuple, "OOOOdO", &position, &axis, &variance, &misfit, &found->chi2, &ambient)) {
        return false;
    }
    found->position = doubles_of(given, position, 3 * magnets, "positions");
    found->axis = doubles_of(given, axis, 3 * magnets, "axes");
    found->variance = doubles_of(given, variance, FMFTS_POSE_CHANGE * magnets, "variances");
    found->misfit_t = doubles_of(given, misfit, axes, "residuals");
    found->ambient_t = doubles_or_none(given, ambient, 3, "ambient field");
    return given->fits;
}

/* What the message of a frame is about. */
typedef struct {
    PyObject *mounted, *used, *fingers, *magnets;
    int contact;
    double displacement_m, displacement_sd_m;
} judged;

bool fmfts_fits_mounted(const fmfts_mounted_parameters *mounted, double magnets)
{
    if (mounted->magnets != magnets || !(magnets >= 0.0 && magnets <= FMFTS_TOLD_MAGNETS) ||
        !(mounted->causes >= 0.0 && mounted->causes <= FMFTS_TOLD_CAUSES)) {
        PyErr_SetString(PyExc_ValueError, "parameters of a pad with other magnets, or with more causes of errors than there is room for");
        return false;
    }
    return true;
}

/* Fills the reading from what Python has judged. */
static bool take_judged(fmfts_pad_object *self, arrays *given, const judged *j)
{
    fmfts_reading *reading = &self->reading;
    const size_t axes = 3 * (size_t)self->pad.parameters->pose.sensors;
    const fmfts_mounted_parameters *mounted = next_of(given, j->mounted, PyBUF_SIMPLE, sizeof *mounted, "parameters of a mounted pad");
    const uint8_t *used = next_of(given, j->used, PyBUF_SIMPLE, axes, "axes that were used");
    fmfts_fingers_found fingers;
    fmfts_magnets_found magnets = {.used = used};
    int over_range = 0;
    if (!mounted || !used || !fmfts_fits_mounted(mounted, mounted->magnets)) {
        return false;
    }
    reading->contact = j->contact < 0 ? FMFTS_NOT_KNOWN : j->contact ? FMFTS_IN_CONTACT : FMFTS_NO_CONTACT;
    reading->tells_displacement = !isnan(j->displacement_m);
    reading->displacement_m = j->displacement_m;
    reading->displacement_sd_m = j->displacement_sd_m;
    reading->sensors_ok = 0;
    for (size_t i = 0; i < axes / 3; i++) {
        reading->sensors_ok |= (unsigned)(used[3 * i] && used[3 * i + 1] && used[3 * i + 2]) << i;
    }
    if (j->fingers != Py_None) {
        if (!take_fingers(given, j->fingers, &fingers, &over_range)) {
            return false;
        }
        fmfts_tell_fingers(mounted, &fingers, over_range, &self->several, reading);
    }
    if (j->magnets != Py_None) {
        if (!take_magnets(given, j->magnets, (size_t)mounted->magnets, axes, &magnets)) {
            return false;
        }
        fmfts_tell_magnets(mounted, &magnets, axes, &self->several, reading);
    }
    return true;
}

PyObject *fmfts_pad_tell(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    const char *health, *reason;
    double temperature_c;
    int more, has_now;
    judged j;
    arrays given = {.fits = true};
    if (!PyArg_ParseTuple(args, "ssdpOOpi(dd)OO", &health, &reason, &temperature_c, &has_now, &j.mounted, &j.used, &more, &j.contact,
                          &j.displacement_m, &j.displacement_sd_m, &j.fingers, &j.magnets) ||
        !fmfts_still_fits(self)) {
        return NULL;
    }
    fmfts_reading *reading = &self->reading;
    if ((reading->health = fmfts_health_of(health)) == FMFTS_HEALTHS) {
        return PyErr_Format(PyExc_ValueError, "there is no health '%s'", health);
    }
    fmfts_tell_nothing(&self->several, reading);
    reading->temperature_c = temperature_c;
    reading->now.known = reading->now.known && has_now;
    self->several.more = more;
    fmfts_clear(&reading->reason);
    fmfts_say(&reading->reason, "%s", reason);
    bool taken = take_judged(self, &given, &j);
    give_back(&given);
    if (taken && !fmfts_is_finite(reading)) {
        PyErr_SetString(PyExc_ArithmeticError, "a number of the estimate is not finite: check the data of pad.contact.model");
        return NULL;
    }
    return taken ? fmfts_written(self) : NULL;
}

/* The newest samples of the frame; NaN for a sensor without one. */
static void list_newest(const fmfts_pad_object *self, unsigned valid, double *newest_t)
{
    for (size_t axis = 0; axis < 3 * (size_t)self->pad.parameters->pose.sensors; axis++) {
        newest_t[axis] = valid >> axis / 3 & 1 ? self->memory->pose.field_t[axis] : NAN;
    }
}

static bool is_whole(const fmfts_step *step, size_t axes)
{
    bool whole = true;
    for (size_t axis = 0; axis < axes; axis++) {
        whole = whole && isfinite(step->field.field_t[axis]) && !(step->missing.stuck[axis / 3] >> axis % 3 & 1);
    }
    return whole;
}

PyObject *fmfts_pad_align(PyObject *object, PyObject *args)
{
    enum { READINGS, FIELD, SHARE, BEND, REPEATS, NEWEST, ALL };
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    fmfts_frame frame;
    long long sequence, time_us, host_ns;
    arrays given = {.count = ALL};
    Py_buffer *b = given.array;
    PyObject *result = NULL;
    if (!PyArg_ParseTuple(args, "IIIy*LLLdw*w*w*w*w*", &frame.gain_code, &frame.valid, &frame.fresh, &b[READINGS], &sequence,
                          &time_us, &host_ns, &frame.temperature_c, &b[FIELD], &b[SHARE], &b[BEND], &b[REPEATS], &b[NEWEST])) {
        return NULL;
    }
    frame.readings = b[READINGS].buf;
    frame.sequence = sequence;
    frame.time_us = time_us;
    frame.host_ns = host_ns;
    if (fmfts_still_fits(self) && fmfts_is_of(self, &frame, b[READINGS].len)) {
        const size_t axes = 3 * (size_t)self->pad.parameters->pose.sensors, bytes = axes * sizeof(double);
        fmfts_frame_work work;
        const fmfts_field *field = &work.step.field;
        if (fmfts_have_doubles(b + FIELD, (size_t[]){axes, axes / 3, axes, axes, axes}, ALL - FIELD)) {
            fmfts_begin(&self->pad, self->memory, &frame, &work, &self->reading);
            fmfts_align(&work.step, &frame);
            fmfts_date(&frame, &work);
            self->reading.missing = work.step.missing;
            self->aligned = *field;
            self->valid = frame.valid;
            self->fresh = frame.fresh & frame.valid;
            memcpy(b[FIELD].buf, field->field_t, bytes);
            memcpy(b[SHARE].buf, field->noise_share, bytes / 3);
            memcpy(b[BEND].buf, field->bend_t, bytes);
            memcpy(b[REPEATS].buf, self->memory->pose.repeats, bytes);
            list_newest(self, frame.valid, b[NEWEST].buf);
            result = Py_BuildValue("(LNNLN)", (long long)field->instant_us, PyBool_FromLong(field->is_old),
                                   PyBool_FromLong(field->began_anew), (long long)field->leap_us,
                                   PyBool_FromLong(is_whole(&work.step, axes)));
        }
    }
    give_back(&given);
    return result;
}

/* Whether a sample is new, and certainly another than that sensor's in the last frame, but no farther than a finger changes it. */
static bool has_changed(const fmfts_pad_object *self, const fmfts_early *early)
{
    const double sure = 5.7; /* four deviations of a difference of two samples */
    const fmfts_pose_parameters *parameters = &self->pad.parameters->pose;
    const fmfts_pose_memory *last = &self->memory->pose;
    bool is_new = self->pad.parameters->now.early_lead_us > 0.0 && fmfts_is_new(parameters, last->time_us, early), changed = false;
    for (int axis = 3 * early->sensor, k = 0; is_new && k < 3; k++) {
        double noise_t = parameters->noise_t[axis + k] * fabs(parameters->gain[axis + k]);
        double change_t = fabs(early->field_t[k] - last->field_t[axis + k]);
        changed = changed || change_t > sure * noise_t;
        is_new = change_t < FMFTS_JUMP_T;
    }
    return changed && is_new;
}

PyObject *fmfts_pad_follow_early(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    PyObject *memory;
    long long time_us;
    int sensor;
    unsigned int gain_code;
    int16_t counts[3];
    arrays given = {.fits = true};
    if (!PyArg_ParseTuple(args, "OiIhhhL", &memory, &sensor, &gain_code, &counts[0], &counts[1], &counts[2], &time_us) ||
        !fmfts_still_fits(self) || !fmfts_are_possible(0, time_us, 0)) {
        return NULL;
    }
    fmfts_followed_memory *followed = next_of(&given, memory, PyBUF_WRITABLE, sizeof *followed, "memory");
    fmfts_now *now = &self->reading.now;
    if (followed && self->reading.several) {
        fmfts_early early = {.sensor = sensor, .time_us = time_us};
        fmfts_read_early(&self->pad.parameters->pose, gain_code, counts, early.field_t);
        if (followed->finger.pressing == 0.0 && has_changed(self, &early)) {
            give_back(&given);
            return Py_NewRef(Py_True);
        }
        fmfts_follow_finger_early(self->pad.parameters, followed, &early, now);
    }
    give_back(&given);
    if (!followed || !self->reading.several || !now->known) {
        return followed ? Py_NewRef(Py_None) : NULL;
    }
    return fmfts_written(self);
}
