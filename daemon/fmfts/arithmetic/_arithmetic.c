/* fmfts.arithmetic._arithmetic: matrix.c, elementary.h and spline.h for Python, through the stable ABI. matrix.py and
 * spline.py allocate the arrays. */
#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "../common/aligned.h"
#include "elementary.h"
#include "matrix.h"
#include "spline.h"

enum { MOST_BUFFERS = 4, MOST_CELLS = 10000, MOST_POWERS = 64 };

/* The arrays of doubles of one call. */
typedef struct {
    Py_buffer buffer[MOST_BUFFERS];
    int count;
} arrays;

/* The product of sizes from Python if an array can have it; else more than any array has. */
static size_t times(Py_ssize_t count, Py_ssize_t m, Py_ssize_t n)
{
    Py_ssize_t product;
    bool fits = count >= 0 && m >= 0 && n >= 0 && !__builtin_mul_overflow(count, m, &product) &&
                !__builtin_mul_overflow(product, n, &product);
    return fits ? (size_t)product : SIZE_MAX;
}

static bool have_lengths(const arrays *a, const size_t *lengths)
{
    return fmfts_have_doubles(a->buffer, lengths, a->count);
}

static PyObject *none_of(arrays *a)
{
    fmfts_give_back(a->buffer, a->count);
    if (PyErr_Occurred()) {
        return NULL;
    }
    Py_RETURN_NONE;
}

static PyObject *truth_of(arrays *a, bool truth)
{
    fmfts_give_back(a->buffer, a->count);
    return PyErr_Occurred() ? NULL : PyBool_FromLong(truth);
}

/* product(count, m, k, n, a, b, out): `count` products; a or b may be one matrix that all products share. */
static PyObject *product(PyObject *module, PyObject *args)
{
    Py_ssize_t count, m, k, n;
    arrays a = {.count = 3};
    (void)module;
    if (!PyArg_ParseTuple(args, "nnnny*y*w*", &count, &m, &k, &n, &a.buffer[0], &a.buffer[1], &a.buffer[2])) {
        return NULL;
    }
    size_t left = times(1, m, k), right = times(1, k, n), out = times(1, m, n);
    bool one_left = (size_t)a.buffer[0].len / sizeof(double) == left;
    bool one_right = (size_t)a.buffer[1].len / sizeof(double) == right;
    size_t lengths[] = {one_left ? left : times(count, m, k), one_right ? right : times(count, k, n), times(count, m, n)};
    if (have_lengths(&a, lengths)) {
        for (size_t i = 0; out && i < (size_t)count; i++) {
            fmfts_product((size_t)m, (size_t)k, (size_t)n, (const double *)a.buffer[0].buf + (one_left ? 0 : i * left),
                          (const double *)a.buffer[1].buf + (one_right ? 0 : i * right),
                          (double *)a.buffer[2].buf + i * out);
        }
    }
    return none_of(&a);
}

/* cholesky(count, n, a) → True if all are positive definite. */
static PyObject *cholesky(PyObject *module, PyObject *args)
{
    Py_ssize_t count, n;
    arrays a = {.count = 1};
    bool good = true;
    (void)module;
    if (!PyArg_ParseTuple(args, "nnw*", &count, &n, &a.buffer[0])) {
        return NULL;
    }
    if (have_lengths(&a, (size_t[]){times(count, n, n)})) {
        for (Py_ssize_t i = 0; n && i < count && good; i++) {
            good = fmfts_cholesky((size_t)n, (double *)a.buffer[0].buf + i * n * n);
        }
    }
    return truth_of(&a, good);
}

static PyObject *solve(PyObject *args, void (*solver)(size_t, size_t, const double *, double *))
{
    Py_ssize_t count, n, columns;
    arrays a = {.count = 2};
    if (!PyArg_ParseTuple(args, "nnny*w*", &count, &n, &columns, &a.buffer[0], &a.buffer[1])) {
        return NULL;
    }
    if (have_lengths(&a, (size_t[]){times(count, n, n), times(count, n, columns)})) {
        for (Py_ssize_t i = 0; n && i < count; i++) {
            solver((size_t)n, (size_t)columns, (const double *)a.buffer[0].buf + i * n * n,
                   (double *)a.buffer[1].buf + i * n * columns);
        }
    }
    return none_of(&a);
}

/* solve_lower(count, n, columns, lower, x) */
static PyObject *solve_lower(PyObject *module, PyObject *args)
{
    (void)module;
    return solve(args, fmfts_solve_lower);
}

static PyObject *solve_lower_transposed(PyObject *module, PyObject *args)
{
    (void)module;
    return solve(args, fmfts_solve_lower_transposed);
}

/* rotate_columns(m, n, a, v) → True if the rotations converged. */
static PyObject *rotate_columns(PyObject *module, PyObject *args)
{
    Py_ssize_t m, n;
    arrays a = {.count = 2};
    bool ended = true;
    (void)module;
    if (!PyArg_ParseTuple(args, "nnw*w*", &m, &n, &a.buffer[0], &a.buffer[1])) {
        return NULL;
    }
    if (have_lengths(&a, (size_t[]){times(1, m, n), times(1, n, n)})) {
        ended = fmfts_rotate_columns((size_t)m, (size_t)n, a.buffer[0].buf, a.buffer[1].buf);
    }
    return truth_of(&a, ended);
}

/* complement(m, n, a, out) */
static PyObject *complement(PyObject *module, PyObject *args)
{
    Py_ssize_t m, n;
    arrays a = {.count = 2};
    (void)module;
    if (!PyArg_ParseTuple(args, "nnw*w*", &m, &n, &a.buffer[0], &a.buffer[1])) {
        return NULL;
    }
    if (n < 0 || n > m) {
        PyErr_Format(PyExc_ValueError, "%zd columns of %zd rows have no complement", n, m);
    } else if (have_lengths(&a, (size_t[]){times(1, m, n), times(1, m, m - n)})) {
        double *scale = PyMem_Malloc(((size_t)n + 1) * sizeof *scale);
        if (scale) {
            fmfts_complement((size_t)m, (size_t)n, a.buffer[0].buf, scale, a.buffer[1].buf);
        } else {
            PyErr_NoMemory();
        }
        PyMem_Free(scale);
    }
    return none_of(&a);
}

/* cover(first, spacing, cells, at, cell, value, slope): fmfts_cover of each place. */
static PyObject *cover(PyObject *module, PyObject *args)
{
    Py_ssize_t cells;
    fmfts_knots knots;
    arrays a = {.count = 4};
    (void)module;
    if (!PyArg_ParseTuple(args, "ddny*w*w*w*", &knots.first, &knots.spacing, &cells, &a.buffer[0], &a.buffer[1], &a.buffer[2],
                          &a.buffer[3])) {
        return NULL;
    }
    const size_t places = (size_t)a.buffer[0].len / sizeof(double), all = FMFTS_COVERING * places;
    if (cells < 1 || cells > MOST_CELLS || !(knots.spacing > 0.0)) {
        PyErr_Format(PyExc_ValueError, "%zd cells: 1 to %d, of a positive width", cells, MOST_CELLS);
    } else if (have_lengths(&a, (size_t[]){places, places, all, all})) {
        knots.cells = (size_t)cells;
        for (size_t i = 0; i < places; i++) {
            fmfts_splines splines;
            fmfts_cover(&knots, ((const double *)a.buffer[0].buf)[i], &splines);
            ((int64_t *)a.buffer[1].buf)[i] = (int64_t)splines.cell;
            memcpy((double *)a.buffer[2].buf + FMFTS_COVERING * i, splines.value, sizeof splines.value);
            memcpy((double *)a.buffer[3].buf + FMFTS_COVERING * i, splines.slope, sizeof splines.slope);
        }
    }
    return none_of(&a);
}

/* powers(most, count, x, value): fmfts_powers of each number. */
static PyObject *powers(PyObject *module, PyObject *args)
{
    double most, slope[MOST_POWERS];
    Py_ssize_t count;
    arrays a = {.count = 2};
    (void)module;
    if (!PyArg_ParseTuple(args, "dny*w*", &most, &count, &a.buffer[0], &a.buffer[1])) {
        return NULL;
    }
    const size_t numbers = (size_t)a.buffer[0].len / sizeof(double);
    if (count < 0 || count > MOST_POWERS) {
        PyErr_Format(PyExc_ValueError, "%zd powers, at most %d", count, MOST_POWERS);
    } else if (have_lengths(&a, (size_t[]){numbers, (size_t)count * numbers})) {
        for (size_t i = 0; i < numbers; i++) {
            fmfts_powers(((const double *)a.buffer[0].buf)[i], most, (size_t)count, (double *)a.buffer[1].buf + (size_t)count * i,
                         slope);
        }
    }
    return none_of(&a);
}

static PyObject *of_number(PyObject *number, double (*function)(double))
{
    double x = PyFloat_AsDouble(number);
    return x == -1.0 && PyErr_Occurred() ? NULL : PyFloat_FromDouble(function(x));
}

static PyObject *exponential(PyObject *module, PyObject *number)
{
    (void)module;
    return of_number(number, fmfts_exp);
}

static PyObject *logarithm(PyObject *module, PyObject *number)
{
    (void)module;
    return of_number(number, fmfts_log);
}

static PyMethodDef methods[] = {
    {"product", product, METH_VARARGS, NULL},
    {"cholesky", cholesky, METH_VARARGS, NULL},
    {"solve_lower", solve_lower, METH_VARARGS, NULL},
    {"solve_lower_transposed", solve_lower_transposed, METH_VARARGS, NULL},
    {"rotate_columns", rotate_columns, METH_VARARGS, NULL},
    {"complement", complement, METH_VARARGS, NULL},
    {"cover", cover, METH_VARARGS, NULL},
    {"powers", powers, METH_VARARGS, NULL},
    {"exp", exponential, METH_O, NULL},
    {"log", logarithm, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_arithmetic", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__arithmetic(void)
{
    return PyModuleDef_Init(&definition);
}
