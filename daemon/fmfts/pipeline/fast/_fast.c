/* fmfts.pipeline.fast._fast: the fast path for Python, through the stable ABI. Only path.py and fast_loop.py use it. */
#include "_lane.h"

#include <string.h>

enum { INTEGERS = FMFTS_MESSAGE_INTEGERS };

static void release(Py_buffer *buffers, int count)
{
    for (int i = 0; i < count; i++) {
        PyBuffer_Release(&buffers[i]);
    }
}

enum { READINGS = FMFTS_PAD_BUFFERS, FRAME_BUFFERS };

/* Whether sums of these times fit into 64 bits. A board counts 48 bits; a recording may claim any time. */
static bool are_possible(unsigned long long time_us, long long host_ns)
{
    const long long most_ns = 1LL << 62;
    return time_us <= 1ULL << 53 && -most_ns <= host_ns && host_ns <= most_ns;
}

/* judge(pad, (gain_code, valid, fresh, readings), sequence, time_us, host_ns, temperature_c) → (instant in µs, time of `now` in
 * µs, kind of contact), or None if the frame is not healthy; its memory is then unchanged. pad: see _buffers.h. */
static PyObject *judge(PyObject *module, PyObject *args)
{
    Py_buffer b[FRAME_BUFFERS] = {{0}};
    fmfts_frame frame;
    fmfts_pad pad;
    PyObject *given;
    unsigned long long sequence, time_us;
    long long host_ns;
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "O!(IIIy*)KKLd", &PyTuple_Type, &given, &frame.gain_code, &frame.valid, &frame.fresh, &b[READINGS],
                         &sequence, &time_us, &host_ns, &frame.temperature_c) &&
        fmfts_take_pad(given, b, &pad)) {
        fmfts_outcome *outcome = b[FMFTS_OUTCOME_BUFFER].buf;
        fmfts_memory *memory = b[FMFTS_MEMORY_BUFFER].buf;
        frame.readings = b[READINGS].buf;
        frame.time_us = (double)time_us;
        frame.host_ns = host_ns;
        frame.sequence = (double)sequence;
        fmfts_kind kind = are_possible(time_us, host_ns)
                              ? fmfts_frame_step(&pad, memory, &frame, (size_t)b[READINGS].len, outcome)
                              : FMFTS_NO_NUMBER;
        if (kind == FMFTS_NO_NUMBER) {
            result = Py_NewRef(Py_None);
        } else {
            fmfts_go_on(&pad, outcome, fmfts_sampled_ns(host_ns, frame.time_us, outcome->instant_us), memory);
            result = Py_BuildValue("(Ldi)", (long long)outcome->instant_us, outcome->now_us, (int)kind);
        }
    }
    release(b, FRAME_BUFFERS);
    return result;
}

/* early(pad, sensor, gain_code, x, y, z, time_us) → time of `now` in µs, or None where the sample tells nothing. To be called
 * after judge() of a healthy frame. */
static PyObject *early(PyObject *module, PyObject *args)
{
    Py_buffer b[FMFTS_PAD_BUFFERS] = {{0}};
    fmfts_pad pad;
    PyObject *given;
    int sensor, count[3];
    unsigned gain_code;
    unsigned long long time_us;
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "O!iIiiiK", &PyTuple_Type, &given, &sensor, &gain_code, &count[0], &count[1], &count[2],
                         &time_us) &&
        fmfts_take_pad(given, b, &pad)) {
        const int16_t counts[3] = {(int16_t)count[0], (int16_t)count[1], (int16_t)count[2]};
        fmfts_early sample = {.sensor = sensor, .time_us = (double)time_us};
        fmfts_outcome *outcome = b[FMFTS_OUTCOME_BUFFER].buf;
        fmfts_read_early(&pad.parameters->pose, gain_code, counts, sample.field_t);
        fmfts_news news = fmfts_early_step(&pad, b[FMFTS_MEMORY_BUFFER].buf, &sample, outcome);
        result = news == FMFTS_TOLD ? PyFloat_FromDouble(outcome->now_us) : Py_NewRef(Py_None);
    }
    release(b, FMFTS_PAD_BUFFERS);
    return result;
}

/* message(template, places, outcome, seq, t_sample_ns, t_publish_ns, utc_ns, now_ns) → bytes. places: int32 offsets in the
 * template of the integers, then of every number; −1: the template does not have that number. */
static PyObject *message(PyObject *module, PyObject *args)
{
    Py_buffer b[3] = {{0}};
    unsigned long long integer[INTEGERS];
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*KKKKK", &b[0], &b[1], &b[2], &integer[0], &integer[1], &integer[2],
                          &integer[3], &integer[4])) {
        return NULL;
    }
    if (has_size(&b[1], (INTEGERS + FMFTS_NUMBER_COUNT) * sizeof(int32_t), "places") &&
        has_size(&b[2], sizeof(fmfts_outcome), "outcome")) {
        result = PyBytes_FromStringAndSize(b[0].buf, b[0].len);
        if (result) {
            fmfts_write_numbers((uint8_t *)PyBytes_AsString(result), (size_t)b[0].len, b[1].buf, integer,
                       &((const fmfts_outcome *)b[2].buf)->numbers);
        }
    }
    release(b, 3);
    return result;
}

static PyMethodDef methods[] = {
    {"early", early, METH_VARARGS, "Follow a sample that came before its frame; see path.py."},
    {"judge", judge, METH_VARARGS, "Solve one frame up to its contact; see path.py."},
    {"message", message, METH_VARARGS, "Encode its message; see template.py."},
    {NULL, NULL, 0, NULL},
};

typedef struct {
    const char *name;
    int count;
} fmfts_entry;

#define FMFTS_ENTRY(name, count) {#name, count},
static const fmfts_entry PARAMETER_TABLE[] = {FMFTS_PARAMETERS(FMFTS_ENTRY)};
static const fmfts_entry MEMORY_TABLE[] = {FMFTS_MEMORY(FMFTS_ENTRY)};
static const fmfts_entry NUMBERS[] = {FMFTS_NUMBERS(FMFTS_ENTRY)};
static const fmfts_entry SIGHTING_TABLE[] = {FMFTS_SIGHTING(FMFTS_ENTRY)};

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
    return !loop_type || add_layout(module, "PARAMETERS", PARAMETER_TABLE, FMFTS_COUNT(PARAMETER_TABLE)) < 0 ||
                   add_layout(module, "MEMORY", MEMORY_TABLE, FMFTS_COUNT(MEMORY_TABLE)) < 0 ||
                   add_layout(module, "NUMBERS", NUMBERS, FMFTS_COUNT(NUMBERS)) < 0 ||
                   add_layout(module, "SIGHTING", SIGHTING_TABLE, FMFTS_COUNT(SIGHTING_TABLE)) < 0 ||
                   PyModule_AddIntConstant(module, "NEIGHBOURS", FMFTS_NEIGHBOURS) < 0 ||
                   PyModule_AddIntConstant(module, "OUTCOME_BYTES", sizeof(fmfts_outcome)) < 0
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
