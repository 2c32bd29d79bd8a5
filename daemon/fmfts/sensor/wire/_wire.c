/* fmfts.sensor.wire._wire: sample.c and clock.c for Python, through the stable ABI. framing.py and clock.py call it. */
#define PY_SSIZE_T_CLEAN
#include "../../common/stable_abi.h"

#include <Python.h>
#include <string.h>

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

/* Whether sums of these times fit into 64 bits, as those of a board's clock of 48 bits do. Python's have no limit. */
static int are_possible(long long device_us, long long arrival_ns)
{
    return 0 <= device_us && device_us < 1LL << 48 && 0 <= arrival_ns && arrival_ns < 1LL << 62;
}

/* host_time(line, device_us, arrival_ns) → ns on the host's clock, or None when Python must decide; see clock.h. */
static PyObject *host_time(PyObject *module, PyObject *args)
{
    Py_buffer line = {0};
    long long device_us, arrival_ns;
    int64_t host_ns;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "w*LL", &line, &device_us, &arrival_ns)) {
        return NULL;
    }
    if (line.len != (Py_ssize_t)sizeof(fmfts_clock_line)) {
        PyErr_Format(PyExc_ValueError, "line: %zd bytes, %zu expected", line.len, sizeof(fmfts_clock_line));
    } else if (!fmfts_is_aligned(&line, sizeof(double))) {
        /* it has raised */
    } else if (are_possible(device_us, arrival_ns) && fmfts_host_time(line.buf, device_us, arrival_ns, &host_ns)) {
        result = PyLong_FromLongLong(host_ns);
    } else {
        result = Py_NewRef(Py_None);
    }
    PyBuffer_Release(&line);
    return result;
}

static PyMethodDef methods[] = {
    {"host_time", host_time, METH_VARARGS, "Maps a board's time to the host's; see clock.py."},
    {"keep_newest", keep_newest, METH_VARARGS, "Leaves out superseded samples; see newest.py."},
    {"samples", samples, METH_VARARGS, "The sample packets at the beginning of bytes; see framing.py."},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_wire", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__wire(void)
{
    return PyModuleDef_Init(&definition);
}
