/* fmfts.healthy._healthy: the healthy path for Python, through the stable ABI. Called by path.py only. */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#define _POSIX_C_SOURCE 199309L /* clock_gettime */
#include <Python.h>
#include <string.h>
#include <time.h>

#include "../contact/network.h"
#include "../sensor/clock.h"
#include "passage.h"

enum { INTEGERS = FMFTS_MESSAGE_INTEGERS };

static int has_size(const Py_buffer *buffer, size_t size, const char *what)
{
    if (buffer->len == (Py_ssize_t)size) {
        return 1;
    }
    PyErr_Format(PyExc_ValueError, "%s: %zd bytes, %zu expected", what, buffer->len, size);
    return 0;
}

static void release(Py_buffer *buffers, int count)
{
    for (int i = 0; i < count; i++) {
        PyBuffer_Release(&buffers[i]);
    }
}

/* What a frame comes with. FACTS … PASSAGE and READINGS are of the pad; MODEL is the network, or the pose to ask about. */
enum {
    FACTS_BUFFER,
    MEMORY_BUFFER,
    PASSAGE_BUFFER,
    RESPONSE_BUFFER,
    MODEL_BUFFER,
    READINGS_BUFFER,
    FRAME_BUFFERS,
};
typedef struct {
    Py_buffer b[FRAME_BUFFERS];
    fmfts_frame frame;
} fmfts_call;

/* (facts, memory, passage, response, model, (gain_code, valid, fresh, readings), time_us, temperature_c); to be released anyway. */
static int take(PyObject *args, const char *format, fmfts_call *call)
{
    unsigned long long time_us;
    Py_buffer *b = call->b;
    memset(call, 0, sizeof *call);
    if (!PyArg_ParseTuple(args, format, &b[0], &b[1], &b[2], &b[3], &b[4], &call->frame.gain_code,
                          &call->frame.valid, &call->frame.fresh, &b[5], &time_us, &call->frame.temperature_c)) {
        return 0;
    }
    call->frame.readings = b[READINGS_BUFFER].buf;
    call->frame.time_us = (double)time_us;
    return has_size(&b[FACTS_BUFFER], sizeof(fmfts_facts), "facts") &&
           has_size(&b[MEMORY_BUFFER], sizeof(fmfts_memory), "memory") &&
           has_size(&b[PASSAGE_BUFFER], sizeof(fmfts_passage), "passage");
}

/* The frame as far as the question to the contact model; false where it is not healthy. */
static int question_of(const fmfts_call *call)
{
    return fmfts_enter(call->b[FACTS_BUFFER].buf, call->b[MEMORY_BUFFER].buf, &call->frame,
                       (size_t)call->b[READINGS_BUFFER].len, call->b[PASSAGE_BUFFER].buf);
}

/* What is said of the contact model's answer: (instant, kind), or None where it is no number. Only then does `memory`
 * stay what it was. response: of a model that refines; without content otherwise. */
static PyObject *answer(const fmfts_facts *facts, fmfts_memory *memory, fmfts_passage *passage,
                        const Py_buffer *response, const float *contact, const float *jacobian)
{
    fmfts_contact kind = fmfts_leave(facts, passage, response->buf, (size_t)response->len, contact, jacobian);
    if (kind == FMFTS_NO_NUMBER) {
        return Py_NewRef(Py_None);
    }
    *memory = passage->next;
    return Py_BuildValue("(Li)", (long long)passage->question.instant_us, (int)kind);
}

static int view_network(const Py_buffer *model, fmfts_network *network)
{
    if (fmfts_view_network(model->buf, (size_t)model->len / sizeof(float), network) &&
        network->outputs == FMFTS_ANSWERS) {
        return 1;
    }
    PyErr_SetString(PyExc_ValueError, "network: none of three outputs");
    return 0;
}

/* judge(facts, memory, passage, response, network, packed, time_us, temperature_c) → (instant in µs, kind of contact), or None where
 * the frame is not healthy, and `memory` stays what it was. network: a vector of network.h. */
static PyObject *judge(PyObject *module, PyObject *args)
{
    fmfts_call call;
    fmfts_network network;
    PyObject *result = NULL;
    (void)module;
    if (take(args, "y*w*w*z*y*(IIIy*)Kd", &call)) {
        float pose[FMFTS_POSE], contact[FMFTS_ANSWERS], jacobian[FMFTS_ANSWERS * FMFTS_POSE];
        if (!view_network(&call.b[MODEL_BUFFER], &network)) {
            result = NULL;
        } else if (!question_of(&call)) {
            result = Py_NewRef(Py_None);
        } else {
            fmfts_pose_of(call.b[PASSAGE_BUFFER].buf, pose);
            fmfts_infer(&network, pose, contact, jacobian);
            result = answer(call.b[FACTS_BUFFER].buf, call.b[MEMORY_BUFFER].buf, call.b[PASSAGE_BUFFER].buf,
                            &call.b[RESPONSE_BUFFER], contact, jacobian);
        }
    }
    release(call.b, FRAME_BUFFERS);
    return result;
}

/* ask(facts, memory, passage, response, pose, packed, time_us, temperature_c) → is the frame healthy so far? pose (6,) float32: what
 * somebody else is to be asked about, for `conclude`. */
static PyObject *ask(PyObject *module, PyObject *args)
{
    fmfts_call call;
    PyObject *result = NULL;
    (void)module;
    if (take(args, "y*w*w*z*w*(IIIy*)Kd", &call) && has_size(&call.b[MODEL_BUFFER], FMFTS_POSE * sizeof(float), "pose")) {
        int healthy = question_of(&call);
        if (healthy) {
            fmfts_pose_of(call.b[PASSAGE_BUFFER].buf, call.b[MODEL_BUFFER].buf);
        }
        result = PyBool_FromLong(healthy);
    }
    release(call.b, FRAME_BUFFERS);
    return result;
}

/* conclude(facts, memory, passage, response, contact, jacobian) → as `judge`, with another's answer to its question. */
static PyObject *conclude(PyObject *module, PyObject *args)
{
    Py_buffer b[6] = {{0}};
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*w*w*z*y*y*", &b[0], &b[1], &b[2], &b[3], &b[4], &b[5])) {
        return NULL;
    }
    if (has_size(&b[0], sizeof(fmfts_facts), "facts") && has_size(&b[1], sizeof(fmfts_memory), "memory") &&
        has_size(&b[2], sizeof(fmfts_passage), "passage") && has_size(&b[4], FMFTS_ANSWERS * sizeof(float), "contact") &&
        has_size(&b[5], FMFTS_ANSWERS * FMFTS_POSE * sizeof(float), "jacobian")) {
        result = answer(b[0].buf, b[1].buf, b[2].buf, &b[3], b[4].buf, b[5].buf);
    }
    release(b, 6);
    return result;
}

/* message(template, places, passage, seq, t_sample_ns, t_publish_ns, utc_ns) → bytes. places: int32, of the integers and
 * of every number in the template; −1 where it has none. */
static PyObject *message(PyObject *module, PyObject *args)
{
    Py_buffer b[3] = {{0}};
    unsigned long long integer[INTEGERS];
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*KKKK", &b[0], &b[1], &b[2], &integer[0], &integer[1], &integer[2], &integer[3])) {
        return NULL;
    }
    if (has_size(&b[1], (INTEGERS + FMFTS_NUMBER_COUNT) * sizeof(int32_t), "places") &&
        has_size(&b[2], sizeof(fmfts_passage), "passage")) {
        result = PyBytes_FromStringAndSize(b[0].buf, b[0].len);
        if (result) {
            fmfts_fill((uint8_t *)PyBytes_AsString(result), (size_t)b[0].len, b[1].buf, integer,
                       &((const fmfts_passage *)b[2].buf)->numbers);
        }
    }
    release(b, 3);
    return result;
}

/* What `express` is called with. */
enum { NETWORK_BUFFER = MODEL_BUFFER, CLOCK_BUFFER, TEMPLATE_BUFFER, PLACES_BUFFER, EXPRESS_BUFFERS };
typedef struct {
    Py_buffer b[EXPRESS_BUFFERS];
    unsigned pad_index;
    int kind;
    unsigned long long seq;
    const char *data;
    Py_ssize_t size, begin;
    long long arrival_ns;
} fmfts_express_call;

static int take_express(PyObject *args, fmfts_express_call *call)
{
    Py_buffer *b = call->b;
    memset(call, 0, sizeof *call);
    return PyArg_ParseTuple(args, "(y*w*w*z*y*)w*Iy*y*iKy#nL", &b[0], &b[1], &b[2], &b[3], &b[4], &b[CLOCK_BUFFER],
                            &call->pad_index, &b[TEMPLATE_BUFFER], &b[PLACES_BUFFER], &call->kind, &call->seq,
                            &call->data, &call->size, &call->begin, &call->arrival_ns) &&
           has_size(&b[FACTS_BUFFER], sizeof(fmfts_facts), "facts") &&
           has_size(&b[MEMORY_BUFFER], sizeof(fmfts_memory), "memory") &&
           has_size(&b[PASSAGE_BUFFER], sizeof(fmfts_passage), "passage") &&
           has_size(&b[CLOCK_BUFFER], sizeof(fmfts_clock_line), "clock") &&
           has_size(&b[PLACES_BUFFER], (INTEGERS + FMFTS_NUMBER_COUNT) * sizeof(int32_t), "places");
}

/* Where the line that begins at `begin` ends, if it is a sample of this pad, and a thermometer read as the template has
 * it; −1 otherwise. */
static Py_ssize_t read_line(const fmfts_express_call *call, fmfts_sample *sample)
{
    if (call->begin < 0 || call->begin >= call->size) {
        return -1;
    }
    const char *line = call->data + call->begin, *zero = memchr(line, 0, (size_t)(call->size - call->begin));
    /* The first of the numbers is the temperature. */
    int told = ((const int32_t *)call->b[PLACES_BUFFER].buf)[INTEGERS] >= 0;
    if (!zero || !fmfts_read_sample((const uint8_t *)line, (size_t)(zero - line), sample) ||
        sample->pad_index != call->pad_index || told != (sample->temperature_raw != FMFTS_TEMPERATURE_UNKNOWN)) {
        return -1;
    }
    return zero - call->data + 1;
}

/* The sample as far as its contact, in the pad's passage. */
static fmfts_contact contact_of(const fmfts_express_call *call, const fmfts_network *network,
                                const fmfts_sample *sample)
{
    const Py_buffer *b = call->b;
    fmfts_passage *passage = b[PASSAGE_BUFFER].buf;
    float pose[FMFTS_POSE], contact[FMFTS_ANSWERS], jacobian[FMFTS_ANSWERS * FMFTS_POSE];
    const fmfts_frame frame = {
        .readings = sample->readings,
        .time_us = (double)sample->time_us,
        .temperature_c = fmfts_temperature_c(sample),
        .gain_code = sample->gain_code,
        .valid = sample->valid,
        .fresh = sample->fresh,
    };
    if (!fmfts_enter(b[FACTS_BUFFER].buf, b[MEMORY_BUFFER].buf, &frame, FMFTS_READING_BYTES * (size_t)sample->sensors,
                     passage)) {
        return FMFTS_NO_NUMBER;
    }
    fmfts_pose_of(passage, pose);
    fmfts_infer(network, pose, contact, jacobian);
    return fmfts_leave(b[FACTS_BUFFER].buf, passage, b[RESPONSE_BUFFER].buf, (size_t)b[RESPONSE_BUFFER].len, contact,
                       jacobian);
}

static unsigned long long now_ns(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (unsigned long long)now.tv_sec * 1000000000u + (unsigned long long)now.tv_nsec;
}

/* express((facts, memory, passage, response, network), clock, pad_index, template, places, kind, seq, data, begin,
 * arrival_ns) → (end, payload, sequence, t_sample_ns, t_publish_ns), or None where anything but the numbers is not as
 * it was in the frame before: nothing has changed then. */
static PyObject *express(PyObject *module, PyObject *args)
{
    fmfts_express_call call;
    fmfts_network network;
    fmfts_sample sample;
    int64_t host_ns;
    Py_ssize_t end;
    PyObject *result = NULL;
    Py_buffer *b = call.b;
    (void)module;
    if (!take_express(args, &call) || !view_network(&b[NETWORK_BUFFER], &network)) {
        result = NULL;
    } else if ((end = read_line(&call, &sample)) < 0 ||
               !fmfts_host_time(b[CLOCK_BUFFER].buf, (int64_t)sample.time_us, call.arrival_ns, &host_ns) ||
               (int)contact_of(&call, &network, &sample) != call.kind) {
        result = Py_NewRef(Py_None);
    } else {
        fmfts_passage *passage = b[PASSAGE_BUFFER].buf;
        int64_t t_sample_ns = host_ns - 1000 * ((int64_t)sample.time_us - (int64_t)passage->question.instant_us);
        unsigned long long integer[INTEGERS] = {call.seq, (unsigned long long)t_sample_ns, now_ns(CLOCK_MONOTONIC),
                                                now_ns(CLOCK_REALTIME)};
        PyObject *payload = PyBytes_FromStringAndSize(b[TEMPLATE_BUFFER].buf, b[TEMPLATE_BUFFER].len);
        if (payload) {
            fmfts_fill((uint8_t *)PyBytes_AsString(payload), (size_t)b[TEMPLATE_BUFFER].len, b[PLACES_BUFFER].buf,
                       integer, &passage->numbers);
            *(fmfts_memory *)b[MEMORY_BUFFER].buf = passage->next;
            fmfts_heard(b[CLOCK_BUFFER].buf, (int64_t)sample.time_us, call.arrival_ns);
            result = Py_BuildValue("(nNILK)", end, payload, sample.sequence, (long long)t_sample_ns, integer[2]);
        }
    }
    release(b, EXPRESS_BUFFERS);
    return result;
}

static PyMethodDef methods[] = {
    {"judge", judge, METH_VARARGS, "A frame as far as its contact; see path.py."},
    {"ask", ask, METH_VARARGS, "A frame as far as the question to another's contact model; see path.py."},
    {"conclude", conclude, METH_VARARGS, "Another's answer to that question; see path.py."},
    {"express", express, METH_VARARGS, "A frame from its bytes to its message; see path.py."},
    {"message", message, METH_VARARGS, "What is published of it; see template.py."},
    {NULL, NULL, 0, NULL},
};

typedef struct {
    const char *name;
    int count;
} fmfts_entry;

#define FMFTS_ENTRY(name, count) {#name, count},
static const fmfts_entry FACTS[] = {FMFTS_FACTS(FMFTS_ENTRY)};
static const fmfts_entry MEMORY[] = {FMFTS_MEMORY(FMFTS_ENTRY)};
static const fmfts_entry NUMBERS[] = {FMFTS_NUMBERS(FMFTS_ENTRY)};

static int add_layout(PyObject *module, const char *name, const fmfts_entry *entries, size_t count)
{
    PyObject *layout = PyDict_New();
    for (size_t i = 0; layout && i < count; i++) {
        PyObject *size = PyLong_FromLong(entries[i].count);
        if (!size || PyDict_SetItemString(layout, entries[i].name, size) < 0) {
            Py_CLEAR(layout);
        }
        Py_XDECREF(size);
    }
    int failed = layout ? PyModule_AddObjectRef(module, name, layout) : -1;
    Py_XDECREF(layout);
    return failed;
}

#define FMFTS_COUNT(entries) (sizeof(entries) / sizeof(entries)[0])

static int set_constants(PyObject *module)
{
    return add_layout(module, "FACTS", FACTS, FMFTS_COUNT(FACTS)) < 0 ||
                   add_layout(module, "MEMORY", MEMORY, FMFTS_COUNT(MEMORY)) < 0 ||
                   add_layout(module, "NUMBERS", NUMBERS, FMFTS_COUNT(NUMBERS)) < 0 ||
                   PyModule_AddIntConstant(module, "PASSAGE_BYTES", sizeof(fmfts_passage)) < 0
               ? -1
               : 0;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_constants},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_healthy", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__healthy(void)
{
    return PyModuleDef_Init(&definition);
}
