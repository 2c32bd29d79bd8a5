/* A pad whose samples a Loop takes from a board's line: each becomes its message, whatever its health. */
#include "_pad.h"

#include <math.h>
#include <string.h>
#include <time.h>

#include "../sensor/wire/sample.h"

enum { MOST_MISSING = 1000 }; /* frames; after more, or a repeated one, Python decides (statistics.py) */

/* Whether the sample is this pad's next one, and there is room to account for it. Python handles all other samples. */
static bool is_expected(const fmfts_pad_object *self, const fmfts_sample *sample)
{
    const fmfts_pose_parameters *pose = &self->pad.parameters->pose;
    const fmfts_lent *lent = &self->lent;
    return sample->pad_index == lent->pad_index && sample->sensors == (unsigned)pose->sensors &&
           pose->step_t[3 * sample->gain_code] != 0.0 && sample->sequence - lent->sequence - 1 < MOST_MISSING &&
           lent->frames < FMFTS_TALLIED && lent->changes < FMFTS_CHANGES;
}

static bool is_overdue(const fmfts_lent *lent, int64_t host_ns)
{
    return fmfts_now_ns(CLOCK_MONOTONIC) - host_ns > lent->overdue_ns;
}

/* The result for a packet without a message. Python finds an error of the contact model again, and raises it. */
static fmfts_handled without_message(fmfts_handled otherwise)
{
    if (!PyErr_Occurred()) {
        return otherwise;
    }
    if (!PyErr_ExceptionMatches(PyExc_Exception)) {
        return FMFTS_FAILED; /* somebody ends the program */
    }
    PyErr_Clear();
    return FMFTS_FOR_PYTHON;
}

/* Counts a frame whose message is written. before: gist and time of sample of the message before. */
static fmfts_handled tally(fmfts_pad_object *self, const fmfts_sample *sample, const fmfts_gist *before, int64_t before_ns)
{
    fmfts_lent *lent = &self->lent;
    const fmfts_gist *now = &self->gist;
    if (lent->frames == 0) {
        lent->first_sequence = sample->sequence;
    }
    lent->frames++;
    lent->sequence = sample->sequence;
    if (self->times.sampled != before_ns) {
        lent->latency_s[lent->latencies++] = (double)(self->times.published - self->times.sampled) * 1e-9;
    }
    if (now->health != before->health || now->contact != before->contact || now->over_range != before->over_range ||
        now->slipping != before->slipping) {
        PyObject *message = PyBytes_FromStringAndSize((const char *)self->message, (Py_ssize_t)self->message_bytes);
        if (!message) {
            return FMFTS_FAILED;
        }
        lent->change[lent->changes++] = message;
    }
    return FMFTS_WRITTEN;
}

static fmfts_handled handle_frame(fmfts_pad_object *self, const fmfts_sample *sample, int64_t arrival_ns)
{
    const fmfts_pose_parameters *pose = &self->pad.parameters->pose;
    fmfts_lent *lent = &self->lent;
    const fmfts_gist before = self->gist;
    const int64_t before_ns = self->memory->message.sampled_ns;
    fmfts_clock_line clock = *lent->clock; /* Python reads this frame again, so the clock must not count it twice */
    fmfts_frame frame = {
        .readings = sample->readings,
        .time_us = (int64_t)sample->time_us,
        .sequence = sample->sequence,
        .temperature_c = fmfts_temperature_c(sample, pose->at_zero_c, pose->c_per_count, pose->range_c),
        .gain_code = sample->gain_code,
        .valid = sample->valid,
        .fresh = sample->fresh,
    };
    if (!is_expected(self, sample) || !fmfts_goes_on(&clock, frame.time_us, arrival_ns)) {
        return FMFTS_FOR_PYTHON; /* the clock restarts after a reset of the board */
    }
    frame.host_ns = fmfts_host_time(&clock, frame.time_us, arrival_ns);
    if (is_overdue(lent, frame.host_ns)) {
        *lent->clock = clock;
        return FMFTS_OVERDUE;
    }
    if (!fmfts_tell(self, &frame)) {
        return without_message(FMFTS_FOR_PYTHON);
    }
    *lent->clock = clock;
    lent->arrival_ns = arrival_ns;
    return tally(self, sample, &before, before_ns);
}

/* A sample that came before its frame: the last message again, with another `now`. */
static fmfts_handled handle_early(fmfts_pad_object *self, const fmfts_early_sample *sample, int64_t arrival_ns)
{
    const fmfts_lent *lent = &self->lent;
    const fmfts_pose_memory *last = &self->memory->pose;
    int64_t time_us = (int64_t)sample->time_us;
    if (sample->pad_index != lent->pad_index || sample->sensor >= (unsigned)self->pad.parameters->pose.sensors ||
        !fmfts_goes_on(lent->clock, time_us, arrival_ns)) {
        return FMFTS_FOR_PYTHON;
    }
    if (is_overdue(lent, last->frame_ns + 1000 * (time_us - last->frame_us))) {
        return FMFTS_SILENT;
    }
    if (!fmfts_tell_early(self, sample->sensor, sample->gain_code, sample->counts, time_us)) {
        return without_message(FMFTS_SILENT);
    }
    self->lent.early++;
    return FMFTS_WRITTEN;
}

fmfts_handled fmfts_handle_line(fmfts_pad_object *self, const uint8_t *line, size_t size, int64_t arrival_ns)
{
    fmfts_sample sample;
    fmfts_early_sample early;
    if (fmfts_read_early_sample(line, size, &early)) {
        return handle_early(self, &early, arrival_ns);
    }
    return fmfts_read_sample(line, size, &sample) ? handle_frame(self, &sample, arrival_ns) : FMFTS_FOR_PYTHON;
}

void fmfts_end(fmfts_pad_object *self)
{
    fmfts_lent *lent = &self->lent;
    for (size_t i = 0; i < lent->changes; i++) {
        Py_CLEAR(lent->change[i]);
    }
    lent->changes = 0;
    PyBuffer_Release(&lent->clock_buffer);
    PyBuffer_Release(&lent->topic);
    self->is_lent = false;
}

PyObject *fmfts_pad_begin(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    fmfts_lent *lent = &self->lent;
    long long overdue_ns;
    if (!fmfts_still_fits(self)) {
        return NULL;
    }
    if (self->is_lent) {
        PyErr_SetString(PyExc_ValueError, "this Pad has begun already");
        return NULL;
    }
    memset(lent, 0, sizeof *lent);
    if (!PyArg_ParseTuple(args, "w*y*IL", &lent->clock_buffer, &lent->topic, &lent->pad_index, &overdue_ns) ||
        !fmfts_has_size(&lent->clock_buffer, sizeof(fmfts_clock_line), "clock")) {
        fmfts_end(self);
        return NULL;
    }
    lent->clock = lent->clock_buffer.buf;
    lent->overdue_ns = overdue_ns;
    lent->first_sequence = lent->sequence = (uint32_t)self->memory->pose.sequence;
    self->is_lent = true;
    return Py_NewRef(Py_None);
}

static PyObject *latencies_of(const fmfts_lent *lent)
{
    PyObject *latencies = PyList_New((Py_ssize_t)lent->latencies);
    for (size_t i = 0; latencies && i < lent->latencies; i++) {
        PyObject *latency = PyFloat_FromDouble(lent->latency_s[i]);
        if (!latency || PyList_SetItem(latencies, (Py_ssize_t)i, latency) < 0) {
            Py_CLEAR(latencies);
        }
    }
    return latencies;
}

static PyObject *changes_of(const fmfts_lent *lent)
{
    PyObject *changes = PyTuple_New((Py_ssize_t)lent->changes);
    for (size_t i = 0; changes && i < lent->changes; i++) {
        if (PyTuple_SetItem(changes, (Py_ssize_t)i, Py_NewRef(lent->change[i])) < 0) {
            Py_CLEAR(changes);
        }
    }
    return changes;
}

PyObject *fmfts_pad_end(PyObject *object, PyObject *unused)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    const fmfts_lent *lent = &self->lent;
    PyObject *ended = NULL;
    (void)unused;
    if (!self->is_lent || !(lent->frames || lent->early)) {
        fmfts_end(self);
        return Py_NewRef(Py_None);
    }
    PyObject *changes = changes_of(lent), *latencies = changes ? latencies_of(lent) : NULL;
    if (latencies) {
        const fmfts_memory *memory = self->memory;
        ended = Py_BuildValue("(nIILLLLy#OO)", (Py_ssize_t)lent->frames, lent->first_sequence, lent->sequence,
                              (long long)lent->arrival_ns, (long long)memory->pose.frame_us, (long long)memory->pose.frame_ns,
                              (long long)self->times.sampled, self->message, (Py_ssize_t)self->message_bytes, changes,
                              latencies);
    }
    Py_XDECREF(changes);
    Py_XDECREF(latencies);
    fmfts_end(self);
    return ended;
}

PyObject *fmfts_pad_last_ns(PyObject *object, PyObject *unused)
{
    const fmfts_pad_object *self = (const fmfts_pad_object *)object;
    (void)unused;
    return PyLong_FromLongLong(self->is_lent && self->lent.frames ? self->lent.arrival_ns : 0);
}

fmfts_pad_object *fmfts_lent_pad(PyObject *object)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    if (!PyObject_TypeCheck(object, fmfts_pad_type)) {
        PyErr_SetString(PyExc_TypeError, "this object is not a Pad");
        return NULL;
    }
    if (!self->is_lent) {
        PyErr_SetString(PyExc_ValueError, "this Pad was not begun");
        return NULL;
    }
    return self;
}
