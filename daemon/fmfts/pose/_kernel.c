/* solver.c for Python: kernel.py calls it, and makes the arrays. */
#include "_kernel.h"

#include "solver.h"

enum { MEASUREMENTS, MAGNETS, PARTS, START, MEAN, COVARIANCE, RATE, DIFFUSION, INPUTS };
enum { STATE = INPUTS, SPREAD, DIRECTION, SUMMARY, BUFFERS };
enum { SUMMARY_VALUES = 6, MOST = 1 << 24 /* limits of pads and rows: within them no product of sizes overflows */ };

typedef struct {
    Py_buffer *buffer;
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

FMFTS_FUNCTION(solve)
{
    call c = {.buffer = b};
    if (!PyArg_ParseTuple(args, "nnny*y*y*y*z*z*z*z*dipw*w*w*w*", &c.pads, &c.rows, &c.magnets, &b[MEASUREMENTS],
                          &b[MAGNETS], &b[PARTS], &b[START], &b[MEAN], &b[COVARIANCE], &b[RATE], &b[DIFFUSION],
                          &c.stop_chi2, &c.max_iterations, &c.project, &b[STATE], &b[SPREAD], &b[DIRECTION],
                          &b[SUMMARY])) {
        return NULL;
    }
    if (c.magnets < 1 || c.magnets > FMFTS_MAX_MAGNETS) {
        return PyErr_Format(PyExc_ValueError, "%zd magnets: 1 to %d fit into one state", c.magnets, FMFTS_MAX_MAGNETS);
    }
    if (c.pads < 0 || c.pads > MOST || c.rows < 0 || c.rows > MOST) {
        return PyErr_Format(PyExc_ValueError, "%zd pads of %zd rows: at most %d", c.pads, c.rows, MOST);
    }
    if (!sizes_agree(&c)) {
        return NULL;
    }
    double *work = PyMem_Malloc((size_t)(FMFTS_WORK(c.rows) + 1) * sizeof(double));
    if (!work) {
        return PyErr_NoMemory();
    }
    Py_BEGIN_ALLOW_THREADS
    solve_pads(&c, work);
    Py_END_ALLOW_THREADS
    PyMem_Free(work);
    return Py_NewRef(Py_None);
}

static PyMethodDef methods[] = {
    FMFTS_METHOD(deviations, "How certain measurements are; see kernel.py."),
    FMFTS_METHOD(dipole, "The field of a magnet, and its derivatives; see dipole.py."),
    FMFTS_METHOD(fields, "The field of several magnets, and its slope; see magnets.py."),
    FMFTS_METHOD(move, "Several magnets after a change of pose; see magnets.py."),
    FMFTS_METHOD(read, "What measurements read in a state; see kernel.py."),
    FMFTS_METHOD(solve, "Solve one problem for each of `pads`; see kernel.py."),
    {NULL, NULL, 0, NULL},
};

static int set_constants(PyObject *module)
{
    return PyModule_AddIntConstant(module, "MAX_MAGNETS", FMFTS_MAX_MAGNETS);
}

FMFTS_MODULE(_kernel, methods, set_constants)
