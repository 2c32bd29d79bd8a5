/* fmfts.pipeline.fast._fast.Lane: lane.h for Python. Only path.py makes Lanes. */
#include "_lane.h"

#include <string.h>

PyTypeObject *fmfts_lane_type;

enum { CLOCK = FMFTS_PAD_BUFFERS, TOPIC, LANE_BUFFERS };

typedef struct {
    PyObject_HEAD
    fmfts_published_lane published;
    Py_buffer buffer[LANE_BUFFERS];
    Py_buffer places[FMFTS_KINDS];
    int begun;
} lane_object;

/* Lane(pad, clock, topic, pad_index, overdue_ns). pad: see _buffers.h. */
static int lane_init(PyObject *object, PyObject *args, PyObject *named)
{
    lane_object *self = (lane_object *)object;
    fmfts_lane *lane = &self->published.lane;
    Py_buffer *b = self->buffer;
    PyObject *pad;
    long long overdue_ns;
    (void)named;
    if (b[CLOCK].obj) {
        PyErr_SetString(PyExc_TypeError, "a Lane can be initialised only once");
        return -1;
    }
    if (!PyArg_ParseTuple(args, "O!w*y*IL", &PyTuple_Type, &pad, &b[CLOCK], &b[TOPIC], &lane->pad_index, &overdue_ns) ||
        !fmfts_take_pad(pad, b, &lane->pad) || !has_size(&b[CLOCK], sizeof(fmfts_clock_line), "clock")) {
        return -1;
    }
    lane->overdue_ns = overdue_ns;
    lane->memory = b[FMFTS_MEMORY_BUFFER].buf;
    lane->outcome = b[FMFTS_OUTCOME_BUFFER].buf;
    lane->clock = b[CLOCK].buf;
    self->published.topic = b[TOPIC].buf;
    self->published.topic_bytes = (size_t)b[TOPIC].len;
    return 0;
}

static void lane_dealloc(PyObject *object)
{
    lane_object *self = (lane_object *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (int i = 0; i < LANE_BUFFERS; i++) {
        PyBuffer_Release(&self->buffer[i]);
    }
    for (int i = 0; i < FMFTS_KINDS; i++) {
        PyBuffer_Release(&self->places[i]);
        PyMem_Free(self->published.lane.message[i].text);
    }
    PyMem_Free(self->published.lane.change);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

/* Takes one template from its tuple (text, places): copies the text, and keeps a view of the places. */
static int take_template(PyObject *given, fmfts_template *template, Py_buffer *places)
{
    const char *text;
    Py_ssize_t size;
    if (!PyArg_ParseTuple(given, "y#y*", &text, &size, places) ||
        !has_size(places, (FMFTS_MESSAGE_INTEGERS + FMFTS_NUMBER_COUNT) * sizeof(int32_t), "places")) {
        return 0;
    }
    uint8_t *copy = PyMem_Realloc(template->text, (size_t)size);
    if (!copy) {
        PyErr_NoMemory();
        return 0;
    }
    memcpy(copy, text, (size_t)size);
    *template = (fmfts_template){copy, (size_t)size, places->buf};
    return 1;
}

/* begin((template of each kind), kind, number, sequence, t_sample_ns, frame_us, frame_ns): of the last message, and its frame's
 * time on the board's clock and on the host's. */
static PyObject *lane_begin(PyObject *object, PyObject *args)
{
    lane_object *self = (lane_object *)object;
    fmfts_lane *lane = &self->published.lane;
    PyObject *given[FMFTS_KINDS];
    size_t longest = 0;
    int kind;
    unsigned sequence;
    unsigned long long number;
    long long t_sample_ns, frame_us, frame_ns;
    self->begun = 0;
    if (!lane->clock) {
        PyErr_SetString(PyExc_ValueError, "this Lane failed to initialise");
        return NULL;
    }
    if (!PyArg_ParseTuple(args, "(OOO)iKILLL", &given[0], &given[1], &given[2], &kind, &number, &sequence,
                          &t_sample_ns, &frame_us, &frame_ns)) {
        return NULL;
    }
    for (int i = 0; i < FMFTS_KINDS; i++) {
        PyBuffer_Release(&self->places[i]);
        if (!PyTuple_Check(given[i]) || !take_template(given[i], &lane->message[i], &self->places[i])) {
            return PyErr_Occurred() ? NULL : (PyErr_SetString(PyExc_TypeError, "a template is a tuple"), NULL);
        }
        longest = lane->message[i].size > longest ? lane->message[i].size : longest;
    }
    uint8_t *change = PyMem_Realloc(lane->change, FMFTS_CHANGES * longest);
    if (!change) {
        return PyErr_NoMemory();
    }
    lane->change = change;
    lane->change_room = longest;
    if (kind < 0 || kind >= FMFTS_KINDS) {
        PyErr_Format(PyExc_ValueError, "there is no kind %d", kind);
        return NULL;
    }
    lane->kind = (fmfts_kind)kind;
    lane->number = number;
    lane->first_sequence = lane->sequence = sequence;
    lane->t_sample_ns = lane->t_publish_ns = t_sample_ns;
    lane->frame_us = frame_us;
    lane->frame_ns = frame_ns;
    lane->passed = lane->early = lane->changes = 0;
    self->begun = 1;
    return Py_NewRef(Py_None);
}

static PyObject *latencies_of(const fmfts_lane *lane)
{
    PyObject *latencies = PyList_New((Py_ssize_t)lane->passed);
    for (size_t i = 0; latencies && i < lane->passed; i++) {
        PyObject *latency = PyFloat_FromDouble(lane->latency_s[i]);
        if (!latency || PyList_SetItem(latencies, (Py_ssize_t)i, latency) < 0) {
            Py_CLEAR(latencies);
        }
    }
    return latencies;
}

static PyObject *changes_of(const fmfts_lane *lane)
{
    PyObject *changes = PyTuple_New((Py_ssize_t)lane->changes);
    for (size_t i = 0; changes && i < lane->changes; i++) {
        const uint8_t *text = lane->change + i * lane->change_room;
        PyObject *change = PyBytes_FromStringAndSize((const char *)text, (Py_ssize_t)lane->change_bytes[i]);
        if (!change || PyTuple_SetItem(changes, (Py_ssize_t)i, change) < 0) {
            Py_CLEAR(changes);
        }
    }
    return changes;
}

/* end() → (frames, first sequence, last sequence, number, kind, payload, changes, arrival_ns, t_sample_ns, t_publish_ns,
 * the last frame's time on the board's clock in µs, and on the host's, latencies in s) of what was handled since `begin`; None
 * if it made no message. */
static PyObject *lane_end(PyObject *object, PyObject *unused)
{
    lane_object *self = (lane_object *)object;
    const fmfts_lane *lane = &self->published.lane;
    const fmfts_template *last = &lane->message[lane->kind];
    int begun = self->begun;
    (void)unused;
    self->begun = 0;
    if (!begun || !(lane->passed || lane->early)) {
        return Py_NewRef(Py_None);
    }
    PyObject *changes = changes_of(lane), *latencies = changes ? latencies_of(lane) : NULL;
    if (!latencies) {
        Py_XDECREF(changes);
        return NULL;
    }
    return Py_BuildValue("(nIIKiy#NLLLLLN)", (Py_ssize_t)lane->passed, lane->first_sequence, lane->sequence,
                         (unsigned long long)lane->number, (int)lane->kind, last->text,
                         (Py_ssize_t)last->size, changes, (long long)lane->arrival_ns, (long long)lane->t_sample_ns,
                         (long long)lane->t_publish_ns, (long long)lane->frame_us,
                         (long long)lane->frame_ns, latencies);
}

/* last_ns() → arrival time of the last frame handled since `begin`; 0 if there was none. */
static PyObject *lane_last_ns(PyObject *object, PyObject *unused)
{
    const lane_object *self = (const lane_object *)object;
    const fmfts_lane *lane = &self->published.lane;
    (void)unused;
    return PyLong_FromLongLong(self->begun && lane->passed ? lane->arrival_ns : 0);
}

fmfts_published_lane *fmfts_lane_of(PyObject *object)
{
    lane_object *self = (lane_object *)object;
    if (!PyObject_TypeCheck(object, fmfts_lane_type)) {
        PyErr_SetString(PyExc_TypeError, "this object is not a Lane");
        return NULL;
    }
    if (!self->begun) {
        PyErr_SetString(PyExc_ValueError, "this Lane was not begun");
        return NULL;
    }
    return &self->published;
}

static PyMethodDef methods[] = {
    {"begin", lane_begin, METH_VARARGS, "Let C handle frames from now on; see lane.py."},
    {"end", lane_end, METH_NOARGS, "Stop, and tell what was handled; see lane.py."},
    {"last_ns", lane_last_ns, METH_NOARGS, "When the last handled frame arrived; see lane.py."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_init, (void *)lane_init},
    {Py_tp_dealloc, (void *)lane_dealloc},
    {Py_tp_methods, methods},
    {0, NULL},
};

PyType_Spec fmfts_lane_spec = {
    .name = "fmfts.pipeline.fast._fast.Lane",
    .basicsize = sizeof(lane_object),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = slots,
};
