/* fmfts.pipeline._pad.Loop: waits for bytes, and publishes the contacts of the frames in them; see fast_loop.py. */
#include "_board_line.h"

#include <errno.h>
#include <string.h>
#include <sys/epoll.h>
#include <time.h>

enum {
    EVENTS = 256,
    MOST_DESCRIPTORS = 1 << 24, /* more than Linux gives */
    /* The loop is behind after this many waits in a row in which something was ready at once. A short stall of the
     * computer takes fewer, so that its backlog is not lost. */
    BUSY_WAITS = 4,
    REST_NS = 50000, /* a wait that took this long began with nothing ready */
};

typedef struct {
    PyObject_HEAD
    int epoll;
    fmfts_bus bus;
    fmfts_board_line **line; /* by descriptor */
    int lines;
    fmfts_patience in_time, behind;
    int busy_waits;  /* in a row */
    int waiting;     /* lines that wait for Python */
    int last_served; /* the descriptor that wait() returned last of them */
} loop_object;

/* Loop(epoll, send, socket, in_time, behind): the epoll descriptor; the addresses of zmq_send and of a socket whose sends
 * never block; Patience of patience.py while the loop is in time, and while it is behind. */
static int loop_init(PyObject *object, PyObject *args, PyObject *named)
{
    loop_object *self = (loop_object *)object;
    unsigned long long send, socket;
    long long in_time_us, behind_us;
    (void)named;
    if (!PyArg_ParseTuple(args, "iKK(IL)(IL)", &self->epoll, &send, &socket, &self->in_time.most, &in_time_us,
                          &self->behind.most, &behind_us)) {
        return -1;
    }
    self->in_time.longest_us = in_time_us;
    self->behind.longest_us = behind_us;
    self->bus.send = (int (*)(void *, const void *, size_t, int))(uintptr_t)send;
    self->bus.socket = (void *)(uintptr_t)socket;
    return 0;
}

static void loop_dealloc(PyObject *object)
{
    loop_object *self = (loop_object *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (int i = 0; i < self->lines; i++) {
        fmfts_free_line(self->line[i]);
    }
    PyMem_Free(self->line);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static fmfts_board_line *line_of(const loop_object *self, int descriptor)
{
    return descriptor >= 0 && descriptor < self->lines ? self->line[descriptor] : NULL;
}

static int add(PyObject *list, int descriptor)
{
    PyObject *item = PyLong_FromLong(descriptor);
    int failed = !item || PyList_Append(list, item) < 0;
    Py_XDECREF(item);
    return !failed;
}

/* Makes the table large enough for the descriptor. 0 and MemoryError if it cannot. */
static int make_room(loop_object *self, int descriptor)
{
    if (descriptor < self->lines) {
        return 1;
    }
    fmfts_board_line **grown = PyMem_Realloc(self->line, ((size_t)descriptor + 1) * sizeof *grown);
    if (!grown) {
        PyErr_NoMemory();
        return 0;
    }
    memset(grown + self->lines, 0, (size_t)(descriptor + 1 - self->lines) * sizeof *grown);
    self->line = grown;
    self->lines = descriptor + 1;
    return 1;
}

/* begin(descriptor, unread, pads): until `end`, these begun pads take the line's frames. unread: bytes read before. */
static PyObject *loop_begin(PyObject *object, PyObject *args)
{
    loop_object *self = (loop_object *)object;
    int descriptor;
    const char *unread;
    Py_ssize_t unread_bytes;
    PyObject *pads;
    if (!PyArg_ParseTuple(args, "iy#O!", &descriptor, &unread, &unread_bytes, &PyTuple_Type, &pads)) {
        return NULL;
    }
    if (descriptor < 0 || descriptor >= MOST_DESCRIPTORS || unread_bytes > FMFTS_ROOM || line_of(self, descriptor)) {
        PyErr_Format(PyExc_ValueError, "descriptor %d with %zd bytes unread is no line that could begin", descriptor,
                     unread_bytes);
        return NULL;
    }
    fmfts_board_line *line = make_room(self, descriptor) ? PyMem_Calloc(1, sizeof *line) : NULL;
    if (!line) {
        return PyErr_NoMemory();
    }
    memcpy(line->unread, unread, (size_t)unread_bytes);
    line->unread_bytes = (size_t)unread_bytes;
    for (Py_ssize_t i = 0; i < PyTuple_Size(pads); i++) {
        PyObject *object = PyTuple_GetItem(pads, i);
        const fmfts_pad_object *pad = fmfts_lent_pad(object);
        if (!pad || pad->lent.pad_index >= FMFTS_WIRE_PADS || line->pad[pad->lent.pad_index]) {
            if (pad) {
                PyErr_Format(PyExc_ValueError, "a board has at most %d pads, and each is one Pad", FMFTS_WIRE_PADS);
            }
            fmfts_free_line(line);
            return NULL;
        }
        line->pad[pad->lent.pad_index] = Py_NewRef(object);
    }
    line->needs_python = unread_bytes > FMFTS_LONGEST_LINE;
    self->waiting += fmfts_waits(line);
    self->line[descriptor] = line;
    return Py_NewRef(Py_None);
}

static bool is_behind(const loop_object *self)
{
    return self->busy_waits >= BUSY_WAITS;
}

static fmfts_patience patience(const loop_object *self)
{
    return is_behind(self) ? self->behind : self->in_time;
}

/* end(descriptor) → (unread, arrival of the last handled frame or 0, frames left out by pad index, whether Python
 * must read the line), or None if the line was not begun. */
static PyObject *loop_end(PyObject *object, PyObject *args)
{
    loop_object *self = (loop_object *)object;
    int descriptor;
    if (!PyArg_ParseTuple(args, "i", &descriptor)) {
        return NULL;
    }
    fmfts_board_line *line = line_of(self, descriptor);
    if (!line) {
        return Py_NewRef(Py_None);
    }
    PyObject *result = Py_BuildValue("(y#L(III)i)", line->unread, (Py_ssize_t)line->unread_bytes,
                                     (long long)line->heard_ns, line->left_out[0], line->left_out[1],
                                     line->left_out[2], (int)line->needs_python);
    self->waiting -= fmfts_waits(line);
    self->line[descriptor] = NULL;
    fmfts_free_line(line);
    return result;
}

/* take(descriptor, data, arrival_ns): handles bytes that the caller has read from the line. False if Python is needed. */
static PyObject *loop_take(PyObject *object, PyObject *args)
{
    loop_object *self = (loop_object *)object;
    int descriptor;
    const char *data;
    Py_ssize_t size;
    long long arrival_ns;
    if (!PyArg_ParseTuple(args, "iy#L", &descriptor, &data, &size, &arrival_ns)) {
        return NULL;
    }
    fmfts_board_line *line = line_of(self, descriptor);
    if (arrival_ns < 0 || arrival_ns >= INT64_C(1) << 62) {
        PyErr_Format(PyExc_ValueError, "bytes that arrived at %lld ns: no clock tells that", arrival_ns);
        return NULL;
    }
    if (!line || size > FMFTS_READ_BYTES) {
        PyErr_Format(PyExc_ValueError, "descriptor %d: no line that takes %zd bytes", descriptor, size);
        return NULL;
    }
    bool waited = fmfts_waits(line);
    bool passed = line->needs_python ||
                  fmfts_pass(line, &self->bus, data, (size_t)size, (int64_t)arrival_ns, patience(self));
    if (!fmfts_send_all(&self->bus) || !passed) { /* nothing unsent may outlive its pad */
        return NULL;
    }
    self->waiting += fmfts_waits(line) - waited;
    return PyBool_FromLong(!line->needs_python);
}

/* Waits once. Returns the number of events; −1 and an exception if that failed. */
static int wait_once(loop_object *self, int64_t until_ns, struct epoll_event *events)
{
    int64_t begun_ns = fmfts_now_ns(CLOCK_MONOTONIC), left_ns = until_ns - begun_ns;
    int timeout_ms = left_ns <= 0 ? 0 : left_ns > 60000000000 ? 60000 : (int)((left_ns + 999999) / 1000000);
    int count;
    Py_BEGIN_ALLOW_THREADS
    count = epoll_wait(self->epoll, events, EVENTS, timeout_ms);
    Py_END_ALLOW_THREADS
    bool has_rested = count == 0 || fmfts_now_ns(CLOCK_MONOTONIC) - begun_ns > REST_NS;
    self->busy_waits = has_rested ? 0 : self->busy_waits + (self->busy_waits < BUSY_WAITS);
    if (count < 0 && errno == EINTR) {
        return PyErr_CheckSignals() < 0 ? -1 : 0;
    }
    if (count < 0) {
        PyErr_SetFromErrno(PyExc_OSError);
    }
    return count;
}

/* Lets the pads take what is readable; adds other descriptors to `wanted`. 0 and an exception if that failed. */
static int serve(loop_object *self, const struct epoll_event *events, int count, PyObject *wanted)
{
    bool served = true;
    for (int i = 0; served && i < count; i++) {
        fmfts_board_line *line = line_of(self, events[i].data.fd);
        if (!line) {
            served = add(wanted, events[i].data.fd);
        } else if (!line->needs_python) {
            bool waited = fmfts_waits(line);
            served = fmfts_serve(line, &self->bus, events[i].data.fd, patience(self));
            self->waiting += fmfts_waits(line) - waited;
        }
    }
    return fmfts_send_all(&self->bus) && served; /* nothing unsent may outlive its pad */
}

/* Adds to `wanted` one line that waits for Python; a line that needs Python comes first. The lines take turns, so the
 * pads of others go on between them. */
static int add_waiting(loop_object *self, PyObject *wanted)
{
    int with_news = -1;
    for (int i = 1; self->waiting > 0 && i <= self->lines; i++) {
        int descriptor = (self->last_served + i) % self->lines;
        const fmfts_board_line *line = self->line[descriptor];
        if (line && line->needs_python) {
            self->last_served = descriptor;
            return add(wanted, descriptor);
        }
        with_news = line && line->has_news && with_news < 0 ? descriptor : with_news;
    }
    if (with_news < 0) {
        return 1;
    }
    self->last_served = with_news;
    return add(wanted, with_news);
}

/* is_behind() → bool. */
static PyObject *loop_is_behind(PyObject *object, PyObject *unused)
{
    (void)unused;
    return PyBool_FromLong(is_behind((const loop_object *)object));
}

/* wait(until_ns) → descriptors that Python must read, as soon as there are any; empty after `until_ns`. */
static PyObject *loop_wait(PyObject *object, PyObject *args)
{
    loop_object *self = (loop_object *)object;
    struct epoll_event events[EVENTS];
    long long until_ns;
    PyObject *wanted = NULL;
    if (!PyArg_ParseTuple(args, "L", &until_ns) || !(wanted = PyList_New(0))) {
        return NULL;
    }
    do {
        int count = wait_once(self, self->waiting ? 0 : until_ns, events);
        if (count < 0 || !serve(self, events, count, wanted) || !add_waiting(self, wanted)) {
            Py_DECREF(wanted);
            return NULL;
        }
    } while (PyList_Size(wanted) == 0 && fmfts_now_ns(CLOCK_MONOTONIC) < until_ns);
    return wanted;
}

static PyMethodDef methods[] = {
    {"begin", loop_begin, METH_VARARGS, "Let a board's frames pass; see runtime/fast_loop.py."},
    {"end", loop_end, METH_VARARGS, "Give the line back to Python; see runtime/fast_loop.py."},
    {"is_behind", loop_is_behind, METH_NOARGS, "Whether something was ready at once for several waits in a row."},
    {"take", loop_take, METH_VARARGS, "Handle the frames in these bytes."},
    {"wait", loop_wait, METH_VARARGS, "Handle frames until Python is needed."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_init, (void *)loop_init},
    {Py_tp_dealloc, (void *)loop_dealloc},
    {Py_tp_methods, methods},
    {0, NULL},
};

PyType_Spec fmfts_loop_spec = {
    .name = "fmfts.pipeline._pad.Loop",
    .basicsize = sizeof(loop_object),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = slots,
};
