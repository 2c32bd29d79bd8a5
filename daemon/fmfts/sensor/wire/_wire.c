/* fmfts.sensor.wire._wire: sample.c and clock.c for Python, through the stable ABI. framing.py and clock.py call it. */
#include "../../common/_binding.h"

#include <string.h>

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
FMFTS_FUNCTION(samples)
{
    const char *data;
    Py_ssize_t size, end = 0;
    (void)b;
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
FMFTS_FUNCTION(keep_newest)
{
    const char *data;
    Py_ssize_t size;
    unsigned most, left_out[FMFTS_WIRE_PADS] = {0};
    long long longest_us;
    (void)b;
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
    if (!PyArg_ParseTuple(args, "w*|LL", line, device_us, arrival_ns) ||
        !fmfts_has_bytes(line, sizeof(fmfts_clock_line), sizeof(double), "line")) {
        return NULL;
    }
    if (*device_us < 0 || *device_us >= 1LL << 48 || *arrival_ns < 0 || *arrival_ns >= 1LL << 62) {
        PyErr_Format(PyExc_ValueError, "a packet at %lld us of its board that arrived at %lld ns: no clock tells that", *device_us,
                     *arrival_ns);
        return NULL;
    }
    return line->buf;
}

/* host_time(line, device_us, arrival_ns) → ns on the host's clock; see clock.h. */
FMFTS_FUNCTION(host_time)
{
    long long device_us, arrival_ns;
    fmfts_clock_line *line = take_clock(args, b, &device_us, &arrival_ns);
    return line ? PyLong_FromLongLong(fmfts_host_time(line, device_us, arrival_ns)) : NULL;
}

/* goes_on(line, device_us, arrival_ns) → bool. */
FMFTS_FUNCTION(goes_on)
{
    long long device_us, arrival_ns;
    fmfts_clock_line *line = take_clock(args, b, &device_us, &arrival_ns);
    return line ? PyBool_FromLong(fmfts_goes_on(line, device_us, arrival_ns)) : NULL;
}

/* above_line(line, device_us, arrival_ns) → ns. */
FMFTS_FUNCTION(above_line)
{
    long long device_us, arrival_ns;
    fmfts_clock_line *line = take_clock(args, b, &device_us, &arrival_ns);
    return line ? PyFloat_FromDouble(fmfts_above_line(line, device_us, arrival_ns)) : NULL;
}

/* restart(line). */
FMFTS_FUNCTION(restart)
{
    long long unused_us, unused_ns;
    fmfts_clock_line *line = take_clock(args, b, &unused_us, &unused_ns);
    if (!line) {
        return NULL;
    }
    fmfts_restart_clock(line);
    return Py_NewRef(Py_None);
}

static PyMethodDef methods[] = {
    FMFTS_METHOD(above_line, "How far a packet is above the clock's line; see clock.h."),
    FMFTS_METHOD(goes_on, "Whether a packet goes on from those before; see clock.h."),
    FMFTS_METHOD(host_time, "Maps a board's time to the host's; see clock.h."),
    FMFTS_METHOD(keep_newest, "Leaves out superseded samples; see newest.py."),
    FMFTS_METHOD(restart, "Forgets a clock's packets; see clock.h."),
    FMFTS_METHOD(samples, "The sample packets at the beginning of bytes; see framing.py."),
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
    return fmfts_add_fields(module, "CLOCK", CLOCK, sizeof CLOCK / sizeof *CLOCK) ||
                   PyModule_AddIntConstant(module, "JUMP_NS", (long)FMFTS_JUMP_NS)
               ? -1
               : 0;
}

FMFTS_MODULE(_wire, methods, set_up)
