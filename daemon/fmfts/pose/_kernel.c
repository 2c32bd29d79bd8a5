/* fmfts.pose._kernel: solver.c and model.h for Python, through the stable ABI. Only kernel.py and dipole.py call it, and make the
 * arrays. */
#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include "../common/aligned.h"
#include "model.h"
#include "solver.h"

enum { MEASUREMENTS, MAGNETS, PARTS, START, MEAN, COVARIANCE, RATE, DIFFUSION, INPUTS };
enum { STATE = INPUTS, SPREAD, DIRECTION, SUMMARY, BUFFERS };
enum { SUMMARY_VALUES = 6, MOST = 1 << 24 /* pads, rows: no product of sizes overflows */ };

typedef struct {
    Py_buffer buffer[BUFFERS];
    Py_ssize_t pads, rows, magnets;
    double stop_chi2;
    int max_iterations, project;
} call;

static const double *input(const call *c, int which, Py_ssize_t pad, Py_ssize_t size)
{
    return c->buffer[which].buf ? (const double *)c->buffer[which].buf + pad * size : NULL;
}

static void solve_pads(const call *c, double *work)
{
    Py_ssize_t values = FMFTS_VALUES(c->magnets), columns = FMFTS_COLUMNS(c->magnets);
    for (Py_ssize_t pad = 0; pad < c->pads; pad++) {
        fmfts_problem problem = {
            .measurements = input(c, MEASUREMENTS, pad, c->rows * FMFTS_MEASUREMENT),
            .rows = (size_t)c->rows,
            .magnets = input(c, MAGNETS, pad, c->magnets * FMFTS_MAGNET),
            .magnet_count = (size_t)c->magnets,
            .parts = (const uint8_t *)c->buffer[PARTS].buf + pad * columns,
            .start = input(c, START, pad, values),
            .prior_mean = input(c, MEAN, pad, values),
            .prior_covariance = input(c, COVARIANCE, pad, columns * columns),
            .rate = input(c, RATE, pad, columns),
            .diffusion = input(c, DIFFUSION, pad, columns),
            .stop_chi2 = c->stop_chi2,
            .max_iterations = c->max_iterations,
            .project = c->project != 0,
        };
        double *summary = (double *)c->buffer[SUMMARY].buf + pad * SUMMARY_VALUES;
        fmfts_summary found = fmfts_solve(&problem, work, (double *)c->buffer[STATE].buf + pad * values,
                                          (double *)c->buffer[SPREAD].buf + pad * columns * columns,
                                          (double *)c->buffer[DIRECTION].buf + pad * columns);
        summary[0] = found.status;
        summary[1] = found.chi2;
        summary[2] = found.residual_t;
        summary[3] = found.iterations;
        summary[4] = (double)found.rows;
        summary[5] = (double)found.unknowns;
    }
}

static int sizes_agree(const call *c)
{
    Py_ssize_t values = FMFTS_VALUES(c->magnets), columns = FMFTS_COLUMNS(c->magnets);
    const Py_ssize_t wanted[BUFFERS] = {
        [MEASUREMENTS] = c->rows * FMFTS_MEASUREMENT,
        [MAGNETS] = c->magnets * FMFTS_MAGNET,
        [START] = values,
        [MEAN] = values,
        [COVARIANCE] = columns * columns,
        [RATE] = columns,
        [DIFFUSION] = columns,
        [STATE] = values,
        [SPREAD] = columns * columns,
        [DIRECTION] = columns,
        [SUMMARY] = SUMMARY_VALUES,
    };
    for (int i = 0; i < BUFFERS; i++) {
        Py_ssize_t bytes = i == PARTS ? columns : wanted[i] * (Py_ssize_t)sizeof(double);
        if (c->buffer[i].buf && c->buffer[i].len != c->pads * bytes) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zd expected", i, c->buffer[i].len, c->pads * bytes);
            return 0;
        }
        if (i != PARTS && !fmfts_is_aligned(&c->buffer[i], sizeof(double))) {
            return 0;
        }
    }
    return 1;
}

static PyObject *solve(PyObject *module, PyObject *args)
{
    call c = {0};
    Py_buffer *b = c.buffer;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "nnny*y*y*y*z*z*z*z*dipw*w*w*w*", &c.pads, &c.rows, &c.magnets, &b[MEASUREMENTS],
                          &b[MAGNETS], &b[PARTS], &b[START], &b[MEAN], &b[COVARIANCE], &b[RATE], &b[DIFFUSION],
                          &c.stop_chi2, &c.max_iterations, &c.project, &b[STATE], &b[SPREAD], &b[DIRECTION],
                          &b[SUMMARY])) {
        return NULL;
    }
    if (c.magnets < 1 || c.magnets > FMFTS_MAX_MAGNETS) {
        PyErr_Format(PyExc_ValueError, "%zd magnets: 1 to %d fit into one state", c.magnets, FMFTS_MAX_MAGNETS);
    } else if (c.pads < 0 || c.pads > MOST || c.rows < 0 || c.rows > MOST) {
        PyErr_Format(PyExc_ValueError, "%zd pads of %zd rows: at most %d", c.pads, c.rows, MOST);
    } else if (sizes_agree(&c)) {
        double *work = PyMem_Malloc((size_t)(FMFTS_WORK(c.rows) + 1) * sizeof(double));
        if (!work) {
            PyErr_NoMemory();
        } else {
            Py_BEGIN_ALLOW_THREADS
            solve_pads(&c, work);
            Py_END_ALLOW_THREADS
            PyMem_Free(work);
            result = Py_NewRef(Py_None);
        }
    }
    for (int i = 0; i < BUFFERS; i++) {
        PyBuffer_Release(&b[i]);
    }
    return result;
}

/* dipole(places, position, axis, strength, octupole, field, by_position, by_axis): of one magnet at many places. */
static PyObject *dipole(PyObject *module, PyObject *args)
{
    enum { PLACES, POSITION, AXIS, FIELD, BY_POSITION, BY_AXIS, ARRAYS };
    Py_buffer b[ARRAYS] = {{0}};
    fmfts_source source;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*ddw*w*w*", &b[PLACES], &b[POSITION], &b[AXIS], &source.strength, &source.octupole,
                          &b[FIELD], &b[BY_POSITION], &b[BY_AXIS])) {
        return NULL;
    }
    const Py_ssize_t one = 3 * sizeof(double), places = b[PLACES].len / one;
    const Py_ssize_t wanted[ARRAYS] = {places * one, one, one, places * one, 3 * places * one, 3 * places * one};
    bool fits = true;
    for (int i = 0; fits && i < ARRAYS; i++) {
        fits = fmfts_is_aligned(&b[i], sizeof(double));
        if (fits && b[i].len != wanted[i]) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zd expected", i, b[i].len, wanted[i]);
            fits = false;
        }
    }
    if (fits) {
        source.position = b[POSITION].buf;
        source.axis = b[AXIS].buf;
        tangent_basis(source.axis, source.basis);
        for (Py_ssize_t i = 0; i < places; i++) {
            fmfts_sight sight;
            look(&source, (double *)b[PLACES].buf + 3 * i, &sight);
            differentiate(&source, &sight, (double *)b[FIELD].buf + 3 * i, (double(*)[3])b[BY_POSITION].buf + 3 * i,
                          (double(*)[3])b[BY_AXIS].buf + 3 * i);
        }
        result = Py_NewRef(Py_None);
    }
    for (int i = 0; i < ARRAYS; i++) {
        PyBuffer_Release(&b[i]);
    }
    return result;
}

static PyMethodDef methods[] = {
    {"dipole", dipole, METH_VARARGS, "The field of a magnet, and its derivatives; see dipole.py."},
    {"solve", solve, METH_VARARGS, "Solve one problem for each of `pads`; see kernel.py."},
    {NULL, NULL, 0, NULL},
};

static int set_constants(PyObject *module)
{
    return PyModule_AddIntConstant(module, "MAX_MAGNETS", FMFTS_MAX_MAGNETS);
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_constants},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_kernel", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__kernel(void)
{
    return PyModuleDef_Init(&definition);
}
