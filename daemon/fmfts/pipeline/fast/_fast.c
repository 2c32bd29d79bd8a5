/* fmfts.pipeline.fast._fast: the healthy path for Python, through the stable ABI. Called by path.py only. */
#include "_lane.h"

#include <string.h>

enum { INTEGERS = FMFTS_MESSAGE_INTEGERS };

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

static PyMethodDef methods[] = {
    {"judge", judge, METH_VARARGS, "A frame as far as its contact; see path.py."},
    {"ask", ask, METH_VARARGS, "A frame as far as the question to another's contact model; see path.py."},
    {"conclude", conclude, METH_VARARGS, "Another's answer to that question; see path.py."},
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

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec)
{
    PyTypeObject *type = (PyTypeObject *)PyType_FromModuleAndSpec(module, spec, NULL);
    if (type && PyModule_AddType(module, type) < 0) {
        Py_DECREF((PyObject *)type);
        type = NULL;
    }
    return type;
}

static int set_up(PyObject *module)
{
    fmfts_lane_type = add_type(module, &fmfts_lane_spec);
    PyTypeObject *loop_type = fmfts_lane_type ? add_type(module, &fmfts_loop_spec) : NULL;
    Py_XDECREF((PyObject *)loop_type);
    return !loop_type || add_layout(module, "FACTS", FACTS, FMFTS_COUNT(FACTS)) < 0 ||
                   add_layout(module, "MEMORY", MEMORY, FMFTS_COUNT(MEMORY)) < 0 ||
                   add_layout(module, "NUMBERS", NUMBERS, FMFTS_COUNT(NUMBERS)) < 0 ||
                   PyModule_AddIntConstant(module, "PASSAGE_BYTES", sizeof(fmfts_passage)) < 0
               ? -1
               : 0;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_up},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_fast", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__fast(void)
{
    return PyModuleDef_Init(&definition);
}
