/* fmfts.arithmetic._arithmetic: matrix.c, elementary.h and spline.h for Python, through the stable ABI. matrix.py and
 * spline.py allocate the arrays. */
#include "../common/_binding.h"

#include <stdlib.h>
#include <string.h>

#include "elementary.h"
#include "finite.h"
#include "matrix.h"
#include "spline.h"

enum { MOST_CELLS = 10000, MOST_POWERS = 64 };

/* The product of sizes from Python if an array can have it; else more than any array has. */
static size_t times(Py_ssize_t count, Py_ssize_t m, Py_ssize_t n)
{
    Py_ssize_t product;
    bool fits = count >= 0 && m >= 0 && n >= 0 && !__builtin_mul_overflow(count, m, &product) &&
                !__builtin_mul_overflow(product, n, &product);
    return fits ? (size_t)product : SIZE_MAX;
}

/* product(count, m, k, n, a, b, out): `count` products; a or b may be one matrix that all products share. */
FMFTS_FUNCTION(product)
{
    enum { LEFT, RIGHT, OUT, ARRAYS };
    Py_ssize_t count, m, k, n;
    if (!PyArg_ParseTuple(args, "nnnny*y*w*", &count, &m, &k, &n, &b[LEFT], &b[RIGHT], &b[OUT])) {
        return NULL;
    }
    size_t left = times(1, m, k), right = times(1, k, n), out = times(1, m, n);
    bool one_left = (size_t)b[LEFT].len / sizeof(double) == left, one_right = (size_t)b[RIGHT].len / sizeof(double) == right;
    size_t wanted[] = {one_left ? left : times(count, m, k), one_right ? right : times(count, k, n), times(count, m, n)};
    if (!fmfts_have_doubles(b, wanted, ARRAYS)) {
        return NULL;
    }
    for (size_t i = 0; out && i < (size_t)count; i++) {
        fmfts_product((size_t)m, (size_t)k, (size_t)n, (const double *)b[LEFT].buf + (one_left ? 0 : i * left),
                      (const double *)b[RIGHT].buf + (one_right ? 0 : i * right), (double *)b[OUT].buf + i * out);
    }
    return Py_NewRef(Py_None);
}

/* cholesky(count, n, a) → True if all are positive definite. */
FMFTS_FUNCTION(cholesky)
{
    Py_ssize_t count, n;
    bool good = true;
    if (!PyArg_ParseTuple(args, "nnw*", &count, &n, &b[0]) || !fmfts_have_doubles(b, (size_t[]){times(count, n, n)}, 1)) {
        return NULL;
    }
    for (Py_ssize_t i = 0; n && i < count && good; i++) {
        good = fmfts_cholesky((size_t)n, (double *)b[0].buf + i * n * n);
    }
    return PyBool_FromLong(good);
}

static PyObject *solve(Py_buffer *b, PyObject *args, void (*solver)(size_t, size_t, const double *, double *))
{
    Py_ssize_t count, n, columns;
    if (!PyArg_ParseTuple(args, "nnny*w*", &count, &n, &columns, &b[0], &b[1]) ||
        !fmfts_have_doubles(b, (size_t[]){times(count, n, n), times(count, n, columns)}, 2)) {
        return NULL;
    }
    for (Py_ssize_t i = 0; n && i < count; i++) {
        solver((size_t)n, (size_t)columns, (const double *)b[0].buf + i * n * n, (double *)b[1].buf + i * n * columns);
    }
    return Py_NewRef(Py_None);
}

/* solve_lower(count, n, columns, lower, x) */
FMFTS_FUNCTION(solve_lower)
{
    return solve(b, args, fmfts_solve_lower);
}

FMFTS_FUNCTION(solve_lower_transposed)
{
    return solve(b, args, fmfts_solve_lower_transposed);
}

/* rotate_columns(m, n, a, v) → True if the rotations converged. */
FMFTS_FUNCTION(rotate_columns)
{
    Py_ssize_t m, n;
    if (!PyArg_ParseTuple(args, "nnw*w*", &m, &n, &b[0], &b[1]) ||
        !fmfts_have_doubles(b, (size_t[]){times(1, m, n), times(1, n, n)}, 2)) {
        return NULL;
    }
    return PyBool_FromLong(fmfts_rotate_columns((size_t)m, (size_t)n, b[0].buf, b[1].buf));
}

/* complement(m, n, a, out) */
FMFTS_FUNCTION(complement)
{
    Py_ssize_t m, n;
    if (!PyArg_ParseTuple(args, "nnw*w*", &m, &n, &b[0], &b[1])) {
        return NULL;
    }
    if (n < 0 || n > m) {
        return PyErr_Format(PyExc_ValueError, "%zd columns of %zd rows have no complement", n, m);
    }
    if (!fmfts_have_doubles(b, (size_t[]){times(1, m, n), times(1, m, m - n)}, 2)) {
        return NULL;
    }
    double *scale = PyMem_Malloc(((size_t)n + 1) * sizeof *scale);
    if (!scale) {
        return PyErr_NoMemory();
    }
    fmfts_complement((size_t)m, (size_t)n, b[0].buf, scale, b[1].buf);
    PyMem_Free(scale);
    return Py_NewRef(Py_None);
}

/* cover(first, spacing, cells, at, cell, value, slope): fmfts_cover of each place. */
FMFTS_FUNCTION(cover)
{
    enum { AT, CELL, VALUE, SLOPE, ARRAYS };
    Py_ssize_t cells;
    fmfts_knots knots;
    if (!PyArg_ParseTuple(args, "ddny*w*w*w*", &knots.first, &knots.spacing, &cells, &b[AT], &b[CELL], &b[VALUE], &b[SLOPE])) {
        return NULL;
    }
    const size_t places = (size_t)b[AT].len / sizeof(double), all = FMFTS_COVERING * places;
    if (cells < 1 || cells > MOST_CELLS || !(knots.spacing > 0.0)) {
        return PyErr_Format(PyExc_ValueError, "%zd cells: 1 to %d, of a positive width", cells, MOST_CELLS);
    }
    if (!fmfts_have_doubles(b, (size_t[]){places, places, all, all}, ARRAYS)) {
        return NULL;
    }
    knots.cells = (size_t)cells;
    for (size_t i = 0; i < places; i++) {
        fmfts_splines splines;
        fmfts_cover(&knots, ((const double *)b[AT].buf)[i], &splines);
        ((int64_t *)b[CELL].buf)[i] = (int64_t)splines.cell;
        memcpy((double *)b[VALUE].buf + FMFTS_COVERING * i, splines.value, sizeof splines.value);
        memcpy((double *)b[SLOPE].buf + FMFTS_COVERING * i, splines.slope, sizeof splines.slope);
    }
    return Py_NewRef(Py_None);
}

/* powers(most, count, x, value): fmfts_powers of each number. */
FMFTS_FUNCTION(powers)
{
    double most, slope[MOST_POWERS];
    Py_ssize_t count;
    if (!PyArg_ParseTuple(args, "dny*w*", &most, &count, &b[0], &b[1])) {
        return NULL;
    }
    const size_t numbers = (size_t)b[0].len / sizeof(double);
    if (count < 0 || count > MOST_POWERS) {
        return PyErr_Format(PyExc_ValueError, "%zd powers, at most %d", count, MOST_POWERS);
    }
    if (!fmfts_have_doubles(b, (size_t[]){numbers, (size_t)count * numbers}, 2)) {
        return NULL;
    }
    for (size_t i = 0; i < numbers; i++) {
        double *value = (double *)b[1].buf + (size_t)count * i;
        fmfts_powers(((const double *)b[0].buf)[i], most, (size_t)count, value, slope);
    }
    return Py_NewRef(Py_None);
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

/* has_finite_numbers(message) */
FMFTS_FUNCTION(has_finite_numbers)
{
    if (!PyArg_ParseTuple(args, "y*", &b[0])) {
        return NULL;
    }
    return PyBool_FromLong(fmfts_has_finite_numbers(b[0].buf, (size_t)b[0].len));
}

static PyMethodDef methods[] = {
    FMFTS_METHOD(product, NULL),
    FMFTS_METHOD(cholesky, NULL),
    FMFTS_METHOD(solve_lower, NULL),
    FMFTS_METHOD(solve_lower_transposed, NULL),
    FMFTS_METHOD(rotate_columns, NULL),
    FMFTS_METHOD(complement, NULL),
    FMFTS_METHOD(cover, NULL),
    FMFTS_METHOD(powers, NULL),
    FMFTS_METHOD(has_finite_numbers, NULL),
    {"exp", exponential, METH_O, NULL},
    {"log", logarithm, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};

static int set_up(PyObject *module)
{
    (void)module;
    return 0;
}

FMFTS_MODULE(_arithmetic, methods, set_up)
