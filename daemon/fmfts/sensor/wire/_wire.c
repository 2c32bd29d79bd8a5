/* fmfts.sensor.wire._wire: sample.c and clock.c for Python, through the stable ABI. framing.py and clock.py call it. */
#define PY_SSIZE_T_CLEAN
#include "../../common/stable_abi.h"

#include <Python.h>
#include <string.h>

#include "../../common/_named.h"
#include "../../common/aligned.h"
#include "clock.h"
#include "newest.h"
#include "sample.h"

static PyObject *told(const char *line, size_t size)
{
    fmfts_sample s;
    fmfts_early_sample e;
    if (fmfts_read_sample((const uint8_t *)line, size, &s)) {
        return Py_BuildValue("(IIKi(IIIy#))", s.pad_index, s.sequence, (unsigned long long)s.time_us, s.temperature_raw,
                             s.gain_code, s.valid, s.fresh, s.readings, (Py_ssize_t)(FMFTS_READING_BYTES * s.sensors));
    }
    if (fmfts_read_early_sample((const uint8_t *)line, size, &e)) {
        return Py_BuildValue("(IIIK(iii))", e.pad_index, e.sensor, e.gain_code, (unsigned long long)e.time_us,
                             (int)e.counts[0], (int)e.counts[1], (int)e.counts[2]);
    }
    return NULL;
}

/* samples(data) → ([(pad_index, sequence, time_us, temperature_raw, (gain_code, valid, fresh, readings)), or of an early sample
 * (pad_index, sensor, gain_code, time_us, (x, y, z)), …], end): the sample packets at the beginning of `data`, and the offset
 * where they end. */
static PyObject *samples(PyObject *module, PyObject *args)
{
    const char *data;
    Py_ssize_t size, end = 0;
    (void)module;
    if (!PyArg_ParseTuple(args, "y#", &data, &size)) {
        return NULL;
    }
    PyObject *found = PyList_New(0);
    while (found && end < size) {
        const char *zero = memchr(data + end, 0, (size_t)(size - end));
        PyObject *sample = zero ? told(data + end, (size_t)(zero - data - end)) : NULL;
        if (!sample && !PyErr_Occurred()) {
            break;
        }
        if (!sample || PyList_Append(found, sample) < 0) {
            Py_CLEAR(found);
        }
        Py_XDECREF(sample);
        end = zero - data + 1;
    }
    return found ? Py_BuildValue("(Nn)", found, end) : NULL;
}

/* keep_newest(data, most, longest_us) → (data without superseded samples, (how many of each pad were left out)); see newest.h. */
static PyObject *keep_newest(PyObject *module, PyObject *args)
{
    const char *data;
    Py_ssize_t size;
    unsigned most, left_out[FMFTS_WIRE_PADS] = {0};
    long long longest_us;
    (void)module;
    if (!PyArg_ParseTuple(args, "y#IL", &data, &size, &most, &longest_us)) {
        return NULL;
    }
    uint8_t *bytes = PyMem_Malloc((size_t)size + 1);
    if (!bytes) {
        return PyErr_NoMemory();
    }
    memcpy(bytes, data, (size_t)size);
    Py_ssize_t stay = (Py_ssize_t)fmfts_keep_newest(bytes, (size_t)size, (fmfts_patience){most, longest_us}, left_out);
    PyObject *result = Py_BuildValue("(y#(III))", bytes, stay, left_out[0], left_out[1], left_out[2]);
    PyMem_Free(bytes);
    return result;
}

/* Takes (line) or (line, device_us, arrival_ns) of a clock. NULL and an exception if the line is none, or sums of the times do not fit
 * into 64 bits, as those of a board's clock of 48 bits do. */
static fmfts_clock_line *take_clock(PyObject *args, Py_buffer *line, long long *device_us, long long *arrival_ns)
{
    *device_us = *arrival_ns = 0;
    if (!PyArg_ParseTuple(args, "w*|LL", line, device_us, arrival_ns)) {
        return NULL;
    }
    if (line->len != (Py_ssize_t)sizeof(fmfts_clock_line)) {
        PyErr_Format(PyExc_ValueError, "line: %zd bytes, %zu expected", line->len, sizeof(fmfts_clock_line));
    } else if (!fmfts_is_aligned(line, sizeof(double))) {
        /* it has raised */
    } else if (*device_us < 0 || *device_us >= 1LL << 48 || *arrival_ns < 0 || *arrival_ns >= 1LL << 62) {
        PyErr_Format(PyExc_ValueError, "a packet at %lld us of its board that arrived at %lld ns: no clock tells that", *device_us,
                     *arrival_ns);
    } else {
        return line->buf;
    }
    return NULL;
}

/* host_time(line, device_us, arrival_ns) → ns on the host's clock; see clock.h. */
static PyObject *host_time(PyObject *module, PyObject *args)
{
    Py_buffer buffer = {0};
    long long device_us, arrival_ns;
    fmfts_clock_line *line = take_clock(args, &buffer, &device_us, &arrival_ns);
    PyObject *result = line ? PyLong_FromLongLong(fmfts_host_time(line, device_us, arrival_ns)) : NULL;
    (void)module;
    PyBuffer_Release(&buffer);
    return result;
}

/* goes_on(line, device_us, arrival_ns) → bool. */
static PyObject *goes_on(PyObject *module, PyObject *args)
{
    Py_buffer buffer = {0};
    long long device_us, arrival_ns;
    fmfts_clock_line *line = take_clock(args, &buffer, &device_us, &arrival_ns);
    PyObject *result = line ? PyBool_FromLong(fmfts_goes_on(line, device_us, arrival_ns)) : NULL;
    (void)module;
    PyBuffer_Release(&buffer);
    return result;
}

/* above_line(line, device_us, arrival_ns) → ns. */
static PyObject *above_line(PyObject *module, PyObject *args)
{
    Py_buffer buffer = {0};
    long long device_us, arrival_ns;
    fmfts_clock_line *line = take_clock(args, &buffer, &device_us, &arrival_ns);
    PyObject *result = line ? PyFloat_FromDouble(fmfts_above_line(line, device_us, arrival_ns)) : NULL;
    (void)module;
    PyBuffer_Release(&buffer);
    return result;
}

/* restart(line). */
static PyObject *restart(PyObject *module, PyObject *args)
{
    Py_buffer buffer = {0};
    long long unused_us, unused_ns;
    fmfts_clock_line *line = take_clock(args, &buffer, &unused_us, &unused_ns);
    (void)module;
    if (line) {
        fmfts_restart_clock(line);
    }
    PyBuffer_Release(&buffer);
    return line ? Py_NewRef(Py_None) : NULL;
}

static PyMethodDef methods[] = {
    {"above_line", above_line, METH_VARARGS, "How far a packet is above the clock's line; see clock.h."},
    {"goes_on", goes_on, METH_VARARGS, "Whether a packet goes on from those before; see clock.h."},
    {"host_time", host_time, METH_VARARGS, "Maps a board's time to the host's; see clock.h."},
    {"keep_newest", keep_newest, METH_VARARGS, "Leaves out superseded samples; see newest.py."},
    {"restart", restart, METH_VARARGS, "Forgets a clock's packets; see clock.h."},
    {"samples", samples, METH_VARARGS, "The sample packets at the beginning of bytes; see framing.py."},
    {NULL, NULL, 0, NULL},
};

/* The fields of fmfts_clock_line; a packet is two numbers. */
static const fmfts_field_name CLOCK[] = {
    {"empty_ns", "<i8", 0},        {"is_host", "<i8", 0},      {"fixed_delay_ns", "<i8", 0}, {"tolerance_ns_per_us", "<f8", 0},
    {"begun", "<i8", 0},           {"newest_us", "<i8", 0},    {"height_ns", "<f8", 0},      {"slope_ns_per_us", "<f8", 0},
    {"origin", "<i8", 2},          {"lowest", "<i8", 2},       {"bucket_end_us", "<i8", 0},  {"late_packets", "<i8", 0},
    {"late_ns", "<i8", 0},         {"least_late_ns", "<f8", 0}, {"minima", "<i8", 0},        {"minimum", "<i8", 2 * FMFTS_SLOPE_BUCKETS},
};

_Static_assert(sizeof(fmfts_clock_line) == 8 * (17 + 2 * FMFTS_SLOPE_BUCKETS), "a clock of other fields");

static int set_up(PyObject *module)
{
    PyObject *fields = fmfts_list_of(CLOCK, sizeof CLOCK / sizeof *CLOCK);
    int failed = !fields || PyModule_AddObjectRef(module, "CLOCK", fields) < 0 ||
                 PyModule_AddIntConstant(module, "JUMP_NS", (long)FMFTS_JUMP_NS) < 0;
    Py_XDECREF(fields);
    return failed ? -1 : 0;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_up},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_wire", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__wire(void)
{
    return PyModuleDef_Init(&definition);
}
