/* fmfts.pose._alignment: push.c for Python, through the stable ABI. Only alignment.py calls it, and makes the arrays. */
#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include "../common/aligned.h"
#include "push.h"

/* The memory, the frame, and what is written, in the order of the arguments. */
enum { FIELDS, TIMES, REPEATS, FIELD, TIME, FRESH, TIMED, ALIGNED, SHARE, BEND, REPEATED, BUFFERS };

static int sizes_agree(const Py_buffer *b, Py_ssize_t sensors)
{
    const Py_ssize_t wanted[BUFFERS] = {
        [FIELDS] = 72 * sensors, [TIMES] = 24 * sensors,   [REPEATS] = 24 * sensors, [FIELD] = 24 * sensors,
        [TIME] = 8 * sensors,    [FRESH] = sensors,        [TIMED] = sensors,        [ALIGNED] = 24 * sensors,
        [SHARE] = 8 * sensors,   [BEND] = 24 * sensors,    [REPEATED] = 24 * sensors,
    };
    for (int i = 0; i < BUFFERS; i++) {
        if (b[i].buf && b[i].len != wanted[i]) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zd expected for %zd sensors", i, b[i].len, wanted[i],
                         sensors);
            return 0;
        }
        if (i != FRESH && i != TIMED && !fmfts_is_aligned(&b[i], sizeof(double))) {
            return 0;
        }
    }
    return 1;
}

/* Whether differences of these times fit into 64 bits. A board counts 48 bits; a recording may claim any time. */
static int times_are_possible(const int64_t *time, Py_ssize_t sensors, long long frame_us)
{
    const int64_t most = (int64_t)1 << 53;
    bool possible = -most <= frame_us && frame_us <= most;
    for (Py_ssize_t i = 0; i < sensors; i++) {
        possible = possible && -most <= time[i] && time[i] <= most;
    }
    if (!possible) {
        PyErr_SetString(PyExc_ValueError, "a sample's time is more than 2^53 us: no board's clock counts so far");
    }
    return possible;
}

/* push(fields, times, repeats, field, time, fresh, timed, aligned, share, bend, repeated, stopped, longest_gap, old, gap_share,
 * unseen_share, jump, most_without_news, without_news, has_time, frame): the instant, whether it is old, whether the clock
 * began anew, and how many frames in a row brought nothing. */
static PyObject *push(PyObject *module, PyObject *args)
{
    Py_buffer b[BUFFERS] = {{0}};
    fmfts_periods periods;
    long long most, without_news, frame_us;
    int has_time;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "w*w*w*y*y*y*z*w*w*w*w*ddddddLLpL", &b[FIELDS], &b[TIMES], &b[REPEATS], &b[FIELD], &b[TIME],
                          &b[FRESH], &b[TIMED], &b[ALIGNED], &b[SHARE], &b[BEND], &b[REPEATED], &periods.stopped_us,
                          &periods.longest_gap_us, &periods.old_us, &periods.gap_share, &periods.unseen_share,
                          &periods.jump_t, &most, &without_news, &has_time, &frame_us)) {
        return NULL;
    }
    Py_ssize_t sensors = b[FRESH].len;
    if (sensors < 1) {
        PyErr_SetString(PyExc_ValueError, "a frame of no sensors");
    } else if (sizes_agree(b, sensors) && times_are_possible(b[TIME].buf, sensors, frame_us)) {
        periods.most_without_news = most;
        fmfts_samples samples = {(size_t)sensors, b[FIELDS].buf, b[TIMES].buf, b[REPEATS].buf, without_news};
        fmfts_pushed frame = {b[FIELD].buf, b[TIME].buf, b[FRESH].buf, b[TIMED].buf, has_time != 0, frame_us};
        fmfts_aligned aligned = {
            .field_t = b[ALIGNED].buf, .noise_share = b[SHARE].buf, .bend_t = b[BEND].buf, .repeats = b[REPEATED].buf};
        fmfts_push(&periods, &samples, &frame, &aligned);
        result = Py_BuildValue("LNNL", (long long)aligned.time_us, PyBool_FromLong(aligned.is_old),
                               PyBool_FromLong(aligned.began_anew), (long long)samples.without_news);
    }
    for (int i = 0; i < BUFFERS; i++) {
        PyBuffer_Release(&b[i]);
    }
    return result;
}

static PyMethodDef methods[] = {
    {"push", push, METH_VARARGS, "Add a frame, and align; see alignment.py."},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_alignment", .m_size = 0, .m_methods = methods};

PyMODINIT_FUNC PyInit__alignment(void)
{
    return PyModuleDef_Init(&definition);
}
