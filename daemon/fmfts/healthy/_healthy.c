/* fmfts.healthy._healthy: the healthy path for Python, through the stable ABI. Called by path.py only. */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <string.h>

#include "healthy.h"

/* What a frame is on its way from `judge` to `conclude`: the memory that it will leave, if its contact is a number. */
typedef struct {
    fmfts_memory next;
    fmfts_question question;
    fmfts_numbers numbers;
} fmfts_passage;

enum { POSE = 6, CONTACT = 3, INTEGERS = 4 };

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

/* judge(facts, memory, passage, pose, (gain_code, valid, fresh, readings), time_us, temperature_c) → the instant in µs, or
 * None where the frame is not healthy. `pose` (6,) float32: what to ask the contact model. */
static PyObject *judge(PyObject *module, PyObject *args)
{
    Py_buffer b[5] = {{0}};
    unsigned long long time_us;
    fmfts_frame frame;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*w*w*(IIIy*)Kd", &b[0], &b[1], &b[2], &b[3], &frame.gain_code, &frame.valid,
                          &frame.fresh, &b[4], &time_us, &frame.temperature_c)) {
        return NULL;
    }
    const fmfts_facts *facts = b[0].buf;
    if (has_size(&b[0], sizeof(fmfts_facts), "facts") && has_size(&b[1], sizeof(fmfts_memory), "memory") &&
        has_size(&b[2], sizeof(fmfts_passage), "passage") && has_size(&b[3], POSE * sizeof(float), "pose")) {
        fmfts_passage *passage = b[2].buf;
        fmfts_field field;
        fmfts_pose pose;
        frame.readings = b[4].buf;
        frame.time_us = (double)time_us;
        memcpy(&passage->next, b[1].buf, sizeof passage->next);
        int healthy = facts->sensors[0] >= 1 && facts->sensors[0] <= FMFTS_SENSORS &&
                      b[4].len == FMFTS_READING_BYTES * (Py_ssize_t)facts->sensors[0] &&
                      fmfts_align(facts, &passage->next, &frame, &field) &&
                      fmfts_track(facts, &passage->next, &field, frame.temperature_c, &pose) &&
                      fmfts_watch(facts, &passage->next, &field) &&
                      fmfts_ask(facts, &passage->next, &pose, &passage->question, &passage->numbers);
        if (healthy) {
            for (int i = 0; i < POSE; i++) {
                ((float *)b[3].buf)[i] = (float)passage->question.pose[i];
            }
            passage->numbers.temperature_c[0] = frame.temperature_c;
            result = PyLong_FromLongLong((long long)field.instant_us);
        } else {
            result = Py_NewRef(Py_None);
        }
    }
    release(b, 5);
    return result;
}

/* conclude(facts, memory, passage, contact, jacobian) → the kind of contact. Unless it is NO_NUMBER, `memory` becomes
 * what the frame leaves. */
static PyObject *conclude(PyObject *module, PyObject *args)
{
    Py_buffer b[5] = {{0}};
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*w*w*y*y*", &b[0], &b[1], &b[2], &b[3], &b[4])) {
        return NULL;
    }
    if (has_size(&b[0], sizeof(fmfts_facts), "facts") && has_size(&b[1], sizeof(fmfts_memory), "memory") &&
        has_size(&b[2], sizeof(fmfts_passage), "passage") && has_size(&b[3], CONTACT * sizeof(float), "contact") &&
        has_size(&b[4], CONTACT * POSE * sizeof(float), "jacobian")) {
        fmfts_passage *passage = b[2].buf;
        fmfts_contact contact =
            fmfts_answer(b[0].buf, &passage->question, b[3].buf, b[4].buf, &passage->numbers);
        if (contact != FMFTS_NO_NUMBER) {
            memcpy(b[1].buf, &passage->next, sizeof passage->next);
        }
        result = PyLong_FromLong(contact);
    }
    release(b, 5);
    return result;
}

/* Into a msgpack float64 or uint64, whose type byte the template has already. */
static void put_unsigned(uint8_t *place, uint64_t value)
{
    for (int byte = 8; byte-- > 0; value >>= 8) {
        place[byte] = (uint8_t)value;
    }
}

static void put_float(uint8_t *place, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_unsigned(place, bits);
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
    const size_t numbers = sizeof(fmfts_numbers) / sizeof(double);
    if (has_size(&b[1], (INTEGERS + numbers) * sizeof(int32_t), "places") &&
        has_size(&b[2], sizeof(fmfts_passage), "passage")) {
        const int32_t *place = b[1].buf;
        const double *number = (const double *)&((const fmfts_passage *)b[2].buf)->numbers;
        result = PyBytes_FromStringAndSize(b[0].buf, b[0].len);
        uint8_t *text = result ? (uint8_t *)PyBytes_AsString(result) : NULL;
        for (size_t i = 0; text && i < INTEGERS + numbers; i++) {
            if (place[i] < 0 || place[i] + 8 > b[0].len) {
                continue;
            }
            if (i < INTEGERS) {
                put_unsigned(text + place[i], integer[i]);
            } else {
                put_float(text + place[i], number[i - INTEGERS]);
            }
        }
    }
    release(b, 3);
    return result;
}

static PyMethodDef methods[] = {
    {"judge", judge, METH_VARARGS, "A frame as far as the contact model; see path.py."},
    {"conclude", conclude, METH_VARARGS, "The contact model's answer to it; see path.py."},
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
                   PyModule_AddIntConstant(module, "PASSAGE_BYTES", sizeof(fmfts_passage)) < 0 ||
                   PyModule_AddIntConstant(module, "NO_NUMBER", FMFTS_NO_NUMBER) < 0
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
