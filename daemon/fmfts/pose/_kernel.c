/* fmfts.pose._kernel: solver.c, model.h and magnets.c for Python, through the stable ABI. Only kernel.py, dipole.py and magnets.py
 * call it, and make the arrays. */
#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include "../common/aligned.h"
#include "magnets.h"
#include "search.h"
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
    fmfts_give_back(b, BUFFERS);
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
    const size_t places = (size_t)b[PLACES].len / sizeof(double[3]), all = 3 * places;
    if (fmfts_have_doubles(b, (size_t[]){all, 3, 3, all, 3 * all, 3 * all}, ARRAYS)) {
        source.position = b[POSITION].buf;
        source.axis = b[AXIS].buf;
        tangent_basis(source.axis, source.basis);
        for (size_t i = 0; i < places; i++) {
            fmfts_sight sight;
            look(&source, (double *)b[PLACES].buf + 3 * i, &sight);
            differentiate(&source, &sight, (double *)b[FIELD].buf + 3 * i, (double(*)[3])b[BY_POSITION].buf + 3 * i,
                          (double(*)[3])b[BY_AXIS].buf + 3 * i);
        }
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, ARRAYS);
    return result;
}

/* move(frames, position, change, moved, axis): of each magnet. */
static PyObject *move(PyObject *module, PyObject *args)
{
    enum { FRAMES, POSITION, CHANGE, MOVED, AXIS, ARRAYS };
    Py_buffer b[ARRAYS] = {{0}};
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*w*w*", &b[FRAMES], &b[POSITION], &b[CHANGE], &b[MOVED], &b[AXIS])) {
        return NULL;
    }
    const size_t count = (size_t)b[POSITION].len / sizeof(double[3]), all = 3 * count;
    if (fmfts_have_doubles(b, (size_t[]){3 * all, all, FMFTS_POSE_CHANGE * count, all, all}, ARRAYS)) {
        for (size_t i = 0; i < count; i++) {
            fmfts_move_magnet((double *)b[FRAMES].buf + 9 * i, (double *)b[POSITION].buf + 3 * i,
                              (double *)b[CHANGE].buf + FMFTS_POSE_CHANGE * i, (double *)b[MOVED].buf + 3 * i,
                              (double *)b[AXIS].buf + 3 * i);
        }
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, ARRAYS);
    return result;
}

/* fields(position, axis, frames, strength, octupole, places, axes, field, slope): of all magnets together. */
static PyObject *fields(PyObject *module, PyObject *args)
{
    enum { POSITION, AXIS, FRAMES, STRENGTH, OCTUPOLE, PLACES, AXES, FIELD, SLOPE, ARRAYS };
    Py_buffer b[ARRAYS] = {{0}};
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*w*w*", &b[POSITION], &b[AXIS], &b[FRAMES], &b[STRENGTH], &b[OCTUPOLE], &b[PLACES],
                          &b[AXES], &b[FIELD], &b[SLOPE])) {
        return NULL;
    }
    const size_t count = (size_t)b[STRENGTH].len / sizeof(double), sensors = (size_t)b[PLACES].len / sizeof(double[3]);
    const size_t values = 3 * sensors, wanted[ARRAYS] = {3 * count, 3 * count, 9 * count,  count, count,
                                                         values,    9 * sensors, values, values * FMFTS_POSE_CHANGE * count};
    if (count > FMFTS_MOST_TOGETHER) {
        PyErr_Format(PyExc_ValueError, "%zu magnets: a pad has %d at most", count, FMFTS_MOST_TOGETHER);
    } else if (fmfts_have_doubles(b, wanted, ARRAYS)) {
        fmfts_fields(&(fmfts_together){count, sensors, b[POSITION].buf, b[AXIS].buf, b[FRAMES].buf, b[STRENGTH].buf,
                                       b[OCTUPOLE].buf, b[PLACES].buf, b[AXES].buf},
                     b[FIELD].buf, b[SLOPE].buf);
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, ARRAYS);
    return result;
}

/* The sources of a state of so many magnets, whose ambient field may have a gradient. */
static void begin_at(fmfts_sources *sources, const double *magnets, size_t count, const double *state)
{
    sources->count = count;
    sources->with_gradient = true;
    fmfts_fill(sources->log_moment, count, NAN);
    place_sources(magnets, state, sources);
}

/* How many magnets array `which` holds; 0 and ValueError if that is no number of them. */
static size_t count_magnets(const Py_buffer *magnets)
{
    const size_t count = (size_t)magnets->len / (FMFTS_MAGNET * sizeof(double));
    if (count < 1 || count > FMFTS_MAX_MAGNETS) {
        PyErr_Format(PyExc_ValueError, "%zu magnets: 1 to %d fit into one state", count, FMFTS_MAX_MAGNETS);
        return 0;
    }
    return count;
}

/* predict(rows, magnets, state, predicted, jacobian): what each measurement would read, and its derivative by a step. */
static PyObject *predict(PyObject *module, PyObject *args)
{
    enum { ROWS, ARE_MAGNETS, AT, PREDICTED, JACOBIAN, ARRAYS };
    Py_buffer b[ARRAYS] = {{0}};
    fmfts_sources sources;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*w*w*", &b[ROWS], &b[ARE_MAGNETS], &b[AT], &b[PREDICTED], &b[JACOBIAN])) {
        return NULL;
    }
    const size_t rows = (size_t)b[PREDICTED].len / sizeof(double), count = count_magnets(&b[ARE_MAGNETS]);
    const size_t columns = FMFTS_COLUMNS(count), wanted[] = {FMFTS_MEASUREMENT * rows, FMFTS_MAGNET * count, FMFTS_VALUES(count),
                                                             rows, columns * rows};
    if (count && fmfts_have_doubles(b, wanted, ARRAYS)) {
        begin_at(&sources, b[ARE_MAGNETS].buf, count, b[AT].buf);
        for (size_t i = 0; i < rows; i++) {
            const double *row = (double *)b[ROWS].buf + FMFTS_MEASUREMENT * i;
            fmfts_sight sight[FMFTS_MAX_MAGNETS];
            look_all(&sources, row, sight);
            ((double *)b[PREDICTED].buf)[i] =
                sense_all(&sources, sight, b[AT].buf, row, row + 3, (double *)b[JACOBIAN].buf + columns * i);
        }
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, ARRAYS);
    return result;
}

/* deviations(rows, magnets, start, rate, diffusion, deviations): as fmfts_prepare_rows has them, infinite where a measurement is left
 * out. False if one is invalid. */
static PyObject *deviations(PyObject *module, PyObject *args)
{
    enum { ROWS, ARE_MAGNETS, AT, RATES, SPREADS, DEVIATIONS, ARRAYS };
    Py_buffer b[ARRAYS] = {{0}};
    fmfts_search search;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*z*z*w*", &b[ROWS], &b[ARE_MAGNETS], &b[AT], &b[RATES], &b[SPREADS], &b[DEVIATIONS])) {
        return NULL;
    }
    const size_t rows = (size_t)b[DEVIATIONS].len / sizeof(double), count = count_magnets(&b[ARE_MAGNETS]);
    const size_t columns = FMFTS_COLUMNS(count), wanted[] = {FMFTS_MEASUREMENT * rows, FMFTS_MAGNET * count, FMFTS_VALUES(count),
                                                             b[RATES].buf ? columns : 0, b[SPREADS].buf ? columns : 0, rows};
    if (count && fmfts_have_doubles(b, wanted, ARRAYS)) {
        bool valid = true;
        fmfts_problem problem = {.rows = 1, .start = b[AT].buf, .rate = b[RATES].buf, .diffusion = b[SPREADS].buf};
        search.problem = &problem;
        search.columns = columns;
        begin_at(&search.sources, b[ARE_MAGNETS].buf, count, b[AT].buf);
        for (size_t i = 0; valid && i < rows; i++) {
            fmfts_row row;
            problem.measurements = (double *)b[ROWS].buf + FMFTS_MEASUREMENT * i;
            valid = fmfts_prepare_rows(&search, &row);
            ((double *)b[DEVIATIONS].buf)[i] = search.row_count ? row.deviation : INFINITY;
        }
        result = PyBool_FromLong(valid);
    }
    fmfts_give_back(b, ARRAYS);
    return result;
}

static PyMethodDef methods[] = {
    {"deviations", deviations, METH_VARARGS, "How certain measurements are; see kernel.py."},
    {"dipole", dipole, METH_VARARGS, "The field of a magnet, and its derivatives; see dipole.py."},
    {"fields", fields, METH_VARARGS, "The field of several magnets, and its slope; see magnets.py."},
    {"move", move, METH_VARARGS, "Several magnets after a change of pose; see magnets.py."},
    {"predict", predict, METH_VARARGS, "What measurements read in a state; see kernel.py."},
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
