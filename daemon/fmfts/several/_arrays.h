/* The arrays that Python gives to one call of C. */
#ifndef FMFTS_SEVERAL_ARRAYS_H
#define FMFTS_SEVERAL_ARRAYS_H

#include "../common/_binding.h"
#include "fit.h"
#include "since_rest.h"

/* The arrays of one call: a packed model, the work space, what is read, then what is written. */
typedef struct {
    Py_buffer *buffer;
    int count;
    fmfts_several model;
    fmfts_several_work *work;
    size_t fingers;
} call;

enum { MODEL, WORK, FIRST };
enum { WORK_DOUBLES = sizeof(fmfts_several_work) / sizeof(double) };

/* Takes the arrays of `args`, `inputs` of them only to read. Raises and returns false where one is no array. */
static inline bool take(call *c, PyObject *args, int inputs, int all)
{
    c->count = 0;
    if (PyTuple_Size(args) != all) {
        PyErr_Format(PyExc_TypeError, "%zd arrays, %d expected", PyTuple_Size(args), all);
        return false;
    }
    for (; c->count < all; c->count++) {
        bool writes = c->count == WORK || c->count >= inputs;
        PyObject *one = PyTuple_GetItem(args, c->count);
        if (!one || PyObject_GetBuffer(one, &c->buffer[c->count], writes ? PyBUF_WRITABLE : PyBUF_SIMPLE) < 0) {
            return false;
        }
    }
    return true;
}

/* Whether array `which` has so many bytes; else raises ValueError. */
static inline bool has(const call *c, int which, size_t bytes)
{
    if ((size_t)c->buffer[which].len == bytes) {
        return true;
    }
    PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zu expected", which, c->buffer[which].len, bytes);
    return false;
}

static inline bool has_doubles(const call *c, int which, size_t doubles)
{
    return has(c, which, doubles * sizeof(double)) && fmfts_is_aligned(&c->buffer[which], sizeof(double));
}

static inline double *array(const call *c, int which)
{
    return c->buffer[which].buf;
}

/* The model and the work space. */
static inline bool has_model(call *c)
{
    const Py_buffer *model = &c->buffer[MODEL];
    c->work = c->buffer[WORK].buf;
    if (!fmfts_is_aligned(model, sizeof(double))) {
        return false;
    }
    if (!fmfts_view_several(model->buf, (size_t)model->len / sizeof(double), &c->model)) {
        PyErr_SetString(PyExc_ValueError, "the model has no spacing, or another size than there is room for");
        return false;
    }
    return has_doubles(c, WORK, WORK_DOUBLES);
}

/* The model, the work space, and fingers in array `finger`. */
static inline bool understood(call *c, int finger)
{
    c->fingers = (size_t)c->buffer[finger].len / (FMFTS_FINGER * sizeof(double));
    if (!has_model(c)) {
        return false;
    }
    if (c->fingers > FMFTS_SEVERAL_FINGERS) {
        PyErr_Format(PyExc_ValueError, "%zu fingers, at most %d", c->fingers, FMFTS_SEVERAL_FINGERS);
        return false;
    }
    return has_doubles(c, finger, FMFTS_FINGER * c->fingers);
}

static inline fmfts_fingers fingers(const call *c, int which)
{
    return (fmfts_fingers){c->fingers, array(c, which)};
}

/* How many values there are, by array `which`. */
static inline size_t used(const call *c, int which)
{
    const uint8_t *values = c->buffer[which].buf;
    size_t count = 0;
    for (Py_ssize_t i = 0; i < c->buffer[which].len; i++) {
        count += values[i] != 0;
    }
    return count;
}

/* Whether the arrays from `first` on have so many doubles. */
static inline bool have_doubles(const call *c, int first, const size_t *doubles, int count)
{
    for (int i = 0; i < count; i++) {
        if (!has_doubles(c, first + i, doubles[i])) {
            return false;
        }
    }
    return true;
}

/* Arrays variance, foreign, used and ambient. foreign: a covariance of all values; empty: there is none. */
static inline bool measures(const call *c, int variance, fmfts_measured *measured)
{
    const int foreign = variance + 1, used = variance + 2, ambient = variance + 3;
    const size_t values = c->model.values, covariances = c->buffer[foreign].len ? values * values : 0;
    *measured = (fmfts_measured){NULL, array(c, variance), c->buffer[used].buf, covariances ? array(c, foreign) : NULL,
                                 array(c, ambient)};
    return has_doubles(c, variance, values) && has_doubles(c, foreign, covariances) && has(c, used, values) &&
           has_doubles(c, ambient, 3);
}

/* The same after an array of the field. */
static inline bool measures_field(const call *c, int field, fmfts_measured *measured)
{
    if (!measures(c, field + 1, measured)) {
        return false;
    }
    measured->field_t = array(c, field);
    return has_doubles(c, field, c->model.values);
}

/* The result of a search: the error, or None; the size of a bad matrix; a number that was found. */
static inline PyObject *told(fmfts_refusal refusal, double number)
{
    static const char *const wrong[] = {
        [FMFTS_FINE] = NULL,
        [FMFTS_NOT_FINITE] = "input",
        [FMFTS_INDEFINITE] = "positive definite",
        [FMFTS_INFINITE] = "finite",
    };
    return Py_BuildValue("znd", wrong[refusal.kind], (Py_ssize_t)refusal.size, number);
}

/* _model.c */
PyObject *fmfts_py_predict(PyObject *module, PyObject *args);
PyObject *fmfts_py_ahead(PyObject *module, PyObject *args);
PyObject *fmfts_py_covariance(PyObject *module, PyObject *args);
PyObject *fmfts_py_resultant(PyObject *module, PyObject *args);

/* _poses.c */
PyObject *fmfts_py_poses(PyObject *module, PyObject *args);
PyObject *fmfts_py_free_poses(PyObject *module, PyObject *args);

/* _since_rest.c */
PyObject *fmfts_py_since_rest(PyObject *module, PyObject *args);

/* _search.c */
PyObject *fmfts_py_fit(PyObject *module, PyObject *args);
PyObject *fmfts_py_whitener(PyObject *module, PyObject *args);
PyObject *fmfts_py_chi2_with(PyObject *module, PyObject *args);
PyObject *fmfts_py_valley(PyObject *module, PyObject *args);
PyObject *fmfts_py_best_single(PyObject *module, PyObject *args);
PyObject *fmfts_py_best_pairs(PyObject *module, PyObject *args);
PyObject *fmfts_py_another(PyObject *module, PyObject *args);

#endif
