/* solver.c for Python: kernel.py calls it, and makes the arrays. */
#include "_kernel.h"

#include "solver.h"

enum { MEASUREMENTS, MAGNETS, PARTS, START, MEAN, COVARIANCE, RATE, DIFFUSION, INPUTS };
enum { STATE = INPUTS, SPREAD, DIRECTION, SUMMARY, BUFFERS };
enum { SUMMARY_VALUES = 6, MOST = 1 << 24 /* limits of pads and rows: no product of sizes overflows */ };

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
    fmfts_give_back(b, BUFFERS);
    return result;
}

static PyMethodDef methods[] = {
    {"deviations", fmfts_py_deviations, METH_VARARGS, "How certain measurements are; see kernel.py."},
    {"dipole", fmfts_py_dipole, METH_VARARGS, "The field of a magnet, and its derivatives; see dipole.py."},
    {"fields", fmfts_py_fields, METH_VARARGS, "The field of several magnets, and its slope; see magnets.py."},
    {"move", fmfts_py_move, METH_VARARGS, "Several magnets after a change of pose; see magnets.py."},
    {"read", fmfts_py_read, METH_VARARGS, "What measurements read in a state; see kernel.py."},
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
