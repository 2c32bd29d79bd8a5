/* fmfts.pipeline._pad.Pad: one pad's frames judged for Python. Only pad_pipeline.py makes Pads. */
#include "_pad.h"

#include <math.h>
#include <string.h>
#include <time.h>

PyTypeObject *fmfts_pad_type;

int64_t fmfts_now_ns(int clock)
{
    struct timespec now;
    clock_gettime((clockid_t)clock, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Pad(…): see _pad.pyi. */
static int pad_init(PyObject *object, PyObject *args, PyObject *named)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    (void)named;
    if (self->given.words) {
        PyErr_SetString(PyExc_TypeError, "a Pad can be initialised only once");
        return -1;
    }
    self->gist.health = FMFTS_HEALTHS;
    return fmfts_take(self, args) ? 0 : -1;
}

static void pad_dealloc(PyObject *object)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    PyTypeObject *type = Py_TYPE(object);
    fmfts_end(self);
    fmfts_release(&self->given);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

/* Encodes the reading as the next message, with `now` relative to one instant on the board's clock and on the host's.
 * */
static bool write_message(fmfts_pad_object *self, int64_t time_us, int64_t host_ns)
{
    const fmfts_reading *reading = &self->reading;
    const fmfts_now *now = &reading->now;
    self->memory->message.number++;
    self->times = (fmfts_times){
        .sampled = self->memory->message.sampled_ns,
        .published = fmfts_now_ns(CLOCK_MONOTONIC),
        .utc = fmfts_now_ns(CLOCK_REALTIME),
        .now = now->known ? host_ns + (int64_t)((now->time_us - (double)time_us) * 1000.0) : 0,
    };
    self->gist = (fmfts_gist){reading->health, reading->contact, reading->over_range, fmfts_is_slipping(reading)};
    self->message_bytes =
        fmfts_write_message(&self->pad.words, reading, self->memory->message.number, &self->times, self->message);
    if (self->message_bytes == 0) {
        PyErr_SetString(PyExc_ValueError, "a message has no room for its words");
    }
    return self->message_bytes > 0;
}

static PyObject *message_of(const fmfts_pad_object *self)
{
    return PyBytes_FromStringAndSize((const char *)self->message, (Py_ssize_t)self->message_bytes);
}

PyObject *fmfts_written(fmfts_pad_object *self)
{
    return write_message(self, self->memory->pose.frame_us, self->memory->pose.frame_ns) ? message_of(self) : NULL;
}

bool fmfts_tell(fmfts_pad_object *self, const fmfts_frame *frame)
{
    bool judged = fmfts_judge(&self->pad, self->memory, frame, &self->reading);
    if (!judged || PyErr_Occurred()) {
        self->reading.judged.known = false; /* the newest frame is not in the memory */
        return false;
    }
    return write_message(self, frame->time_us, frame->host_ns);
}

bool fmfts_tell_early(fmfts_pad_object *self, int sensor, unsigned gain_code, const int16_t counts[3], int64_t time_us)
{
    fmfts_early early = {.sensor = sensor, .time_us = time_us};
    const fmfts_pose_memory *last = &self->memory->pose;
    fmfts_read_early(&self->pad.parameters->pose, gain_code, counts, early.field_t);
    return fmfts_take_early(&self->pad, self->memory, &early, &self->reading) && !PyErr_Occurred() &&
           write_message(self, last->frame_us, last->frame_ns);
}

/* Whether sums of these fit into 64 bits, and the time into a double. A recording may claim anything. */
int fmfts_are_possible(int64_t sequence, int64_t time_us, int64_t host_ns)
{
    const int64_t most = INT64_C(1) << 61, most_us = INT64_C(1) << 53;
    if (0 <= sequence && sequence < most && 0 <= time_us && time_us < most_us && -most < host_ns && host_ns < most) {
        return 1;
    }
    PyErr_SetString(PyExc_ValueError, "no board counts so far");
    return 0;
}

/* 0 and ValueError if the frame is not this pad's. */
int fmfts_is_of(const fmfts_pad_object *self, const fmfts_frame *frame, Py_ssize_t readings_bytes)
{
    Py_ssize_t expected = FMFTS_READING_BYTES * (Py_ssize_t)self->pad.parameters->pose.sensors;
    if (readings_bytes != expected) {
        PyErr_Format(PyExc_ValueError, "readings: %zd bytes, %zd expected", readings_bytes, expected);
        return 0;
    }
    if (frame->gain_code >= FMFTS_GAIN_CODES) {
        PyErr_Format(PyExc_ValueError, "no chip has a gain code %u", frame->gain_code);
        return 0;
    }
    return fmfts_are_possible(frame->sequence, frame->time_us, frame->host_ns);
}

static PyObject *judge(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    Py_buffer readings = {0};
    fmfts_frame frame;
    long long sequence, time_us, host_ns;
    PyObject *result = NULL;
    if (!PyArg_ParseTuple(args, "IIIy*LLLd", &frame.gain_code, &frame.valid, &frame.fresh, &readings, &sequence, &time_us,
                          &host_ns, &frame.temperature_c)) {
        return NULL;
    }
    frame.readings = readings.buf;
    frame.sequence = sequence;
    frame.time_us = time_us;
    frame.host_ns = host_ns;
    if (fmfts_still_fits(self) && fmfts_is_of(self, &frame, readings.len)) {
        if (fmfts_tell(self, &frame)) {
            result = message_of(self);
        } else if (!PyErr_Occurred()) {
            PyErr_SetString(PyExc_ArithmeticError, "a number of the estimate is not finite, most likely of the contact model: "
                                                   "check the data that pad.contact.model was made from");
        }
    }
    PyBuffer_Release(&readings);
    return result;
}

static PyObject *early(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    int sensor;
    unsigned gain_code;
    short count[3];
    long long time_us;
    if (!PyArg_ParseTuple(args, "iIhhhL", &sensor, &gain_code, &count[0], &count[1], &count[2], &time_us) ||
        !fmfts_still_fits(self) || !fmfts_are_possible(0, time_us, 0)) {
        return NULL;
    }
    bool is_there = 0 <= sensor && sensor < (int)self->pad.parameters->pose.sensors;
    if (is_there && fmfts_tell_early(self, sensor, gain_code, (const int16_t[3]){count[0], count[1], count[2]}, time_us)) {
        return message_of(self);
    }
    return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
}

fmfts_health fmfts_health_of(const char *name)
{
    fmfts_health health = FMFTS_OK;
    while (health < FMFTS_HEALTHS && strcmp(name, fmfts_health_name(health)) != 0) {
        health++;
    }
    return health;
}

static PyObject *absent(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    const char *health, *reason;
    if (!PyArg_ParseTuple(args, "ss", &health, &reason) || !fmfts_still_fits(self)) {
        return NULL;
    }
    if (fmfts_health_of(health) == FMFTS_HEALTHS) {
        return PyErr_Format(PyExc_ValueError, "there is no health '%s'", health);
    }
    fmfts_forget_touch(&self->memory->contact); /* the finger may be gone */
    fmfts_forget_motion(&self->memory->motion);
    fmfts_forget_slip(&self->memory->slip);
    memset(&self->reading, 0, sizeof self->reading);
    self->reading.tells_slip = self->pad.parameters->slip.tells_slip != 0.0;
    self->reading.health = fmfts_health_of(health);
    self->reading.temperature_c = NAN;
    fmfts_say(&self->reading.reason, "%s", reason);
    return write_message(self, 0, 0) ? message_of(self) : NULL;
}

static PyObject *missing(PyObject *object, PyObject *unused)
{
    const fmfts_pad_object *self = (const fmfts_pad_object *)object;
    PyObject *found = fmfts_still_fits(self) ? PyDict_New() : NULL;
    (void)unused;
    for (int i = 0; found && i < (int)self->pad.parameters->pose.sensors; i++) {
        fmfts_text text;
        fmfts_clear(&text);
        if (!fmfts_say_missing(&self->reading.missing, i, &text)) {
            continue;
        }
        PyObject *sensor = PyLong_FromLong(i), *words = PyUnicode_FromStringAndSize(text.text, (Py_ssize_t)text.size);
        if (!sensor || !words || PyDict_SetItem(found, sensor, words) < 0) {
            Py_CLEAR(found);
        }
        Py_XDECREF(sensor);
        Py_XDECREF(words);
    }
    return found;
}

static PyObject *last(PyObject *object, void *unused)
{
    const fmfts_pad_object *self = (const fmfts_pad_object *)object;
    const fmfts_gist *gist = &self->gist;
    (void)unused;
    if (!self->memory || gist->health == FMFTS_HEALTHS) {
        return Py_NewRef(Py_None);
    }
    PyObject *contact = gist->contact == FMFTS_NOT_KNOWN ? Py_None : gist->contact == FMFTS_IN_CONTACT ? Py_True : Py_False;
    return Py_BuildValue("(sOOOLL)", fmfts_health_name(gist->health), contact, gist->over_range ? Py_True : Py_False,
                         gist->slipping ? Py_True : Py_False, (long long)self->times.sampled, (long long)self->times.published);
}

static PyMethodDef methods[] = {
    {"judge", judge, METH_VARARGS, "Judge a frame, and encode its message; see _pad.pyi."},
    {"early", early, METH_VARARGS, "Follow a sample that came before its frame; see _pad.pyi."},
    {"absent", absent, METH_VARARGS, "Encode a message without an estimate; see _pad.pyi."},
    {"missing", missing, METH_NOARGS, "What is wrong with the sensors of the last frame; see _pad.pyi."},
    {"begin", fmfts_pad_begin, METH_VARARGS, "Let a Loop judge the pad's frames; see _pad.pyi."},
    {"align", fmfts_pad_align, METH_VARARGS, "Align the samples of a frame; see _pad.pyi."},
    {"bind", fmfts_pad_bind, METH_VARARGS, "Take what frames of several magnets are judged with; see _pad.pyi."},
    {"calm", fmfts_pad_calm, METH_VARARGS, "Judge a calm frame of several magnets; see _pad.pyi."},
    {"follow_early", fmfts_pad_follow_early, METH_VARARGS, "Follow a finger after a sample; see _pad.pyi."},
    {"tell", fmfts_pad_tell, METH_VARARGS, "Encode the message of a pad with several magnets; see _pad.pyi."},
    {"end", fmfts_pad_end, METH_NOARGS, "Stop that, and tell what was handled; see _pad.pyi."},
    {"last_ns", fmfts_pad_last_ns, METH_NOARGS, "When the last handled frame arrived; see _pad.pyi."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef attributes[] = {
    {"last", last, NULL, "What the last message says; see _pad.pyi.", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot pad_slots[] = {
    {Py_tp_init, (void *)pad_init},
    {Py_tp_dealloc, (void *)pad_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_getset, attributes},
    {0, NULL},
};

PyType_Spec fmfts_pad_spec = {
    .name = "fmfts.pipeline._pad.Pad",
    .basicsize = sizeof(fmfts_pad_object),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = pad_slots,
};
