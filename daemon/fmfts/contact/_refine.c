/* fmfts.contact._refine: refine.c for Python, through the stable ABI. Called by refinement.py only, which makes the
 * arrays. */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include "refine.h"

enum { TABLE, EXPONENT, COEFFICIENT, CHANGE, COVARIANCE, PRESS, SPREAD, BUFFERS };
enum { FIRST_X, FIRST_Y, SPACING_X, SPACING_Y, SCALE, TABLE_VALUES };

static int sizes_agree(const Py_buffer *buffer, const fmfts_response *response)
{
    size_t press = 2 + response->loads;
    size_t coefficients = (response->knots[0] + 2) * (response->knots[1] + 2) * response->monomials * FMFTS_CHANGE;
    const size_t wanted[BUFFERS] = {
        [TABLE] = TABLE_VALUES * sizeof(double),
        [EXPONENT] = response->monomials * response->loads * sizeof(int32_t),
        [COEFFICIENT] = coefficients * sizeof(double),
        [CHANGE] = FMFTS_CHANGE * sizeof(double),
        [COVARIANCE] = FMFTS_CHANGE * FMFTS_CHANGE * sizeof(double),
        [PRESS] = press * sizeof(double),
        [SPREAD] = press * press * sizeof(double),
    };
    for (int i = 0; i < BUFFERS; i++) {
        if ((size_t)buffer[i].len != wanted[i]) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zd expected", i, buffer[i].len, wanted[i]);
            return 0;
        }
    }
    for (size_t i = 0; i < response->monomials * response->loads; i++) {
        int32_t exponent = ((const int32_t *)buffer[EXPONENT].buf)[i];
        if (exponent < 0 || exponent > FMFTS_MAX_EXPONENT) {
            PyErr_Format(PyExc_ValueError, "an exponent is %d: 0 to %d", (int)exponent, FMFTS_MAX_EXPONENT);
            return 0;
        }
    }
    return 1;
}

static PyObject *refine(PyObject *module, PyObject *args)
{
    Py_ssize_t knots_x, knots_y, monomials, loads;
    int steps;
    Py_buffer b[BUFFERS] = {0};
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "nnnny*y*y*y*y*iw*w*", &knots_x, &knots_y, &monomials, &loads, &b[TABLE], &b[EXPONENT],
                          &b[COEFFICIENT], &b[CHANGE], &b[COVARIANCE], &steps, &b[PRESS], &b[SPREAD])) {
        return NULL;
    }
    const double *table = b[TABLE].buf;
    if (knots_x < 2 || knots_y < 2 || knots_x > 10000 || knots_y > 10000 || loads < 1 || loads > FMFTS_MAX_LOADS ||
        monomials < 1 || monomials > FMFTS_MAX_MONOMIALS) {
        PyErr_SetString(PyExc_ValueError, "a response of another size than can be refined with");
    } else {
        fmfts_response response = {
            .knots = {(size_t)knots_x, (size_t)knots_y},
            .monomials = (size_t)monomials,
            .loads = (size_t)loads,
            .exponent = b[EXPONENT].buf,
            .coefficient = b[COEFFICIENT].buf,
        };
        if (sizes_agree(b, &response)) {
            response.first_mm[0] = table[FIRST_X];
            response.first_mm[1] = table[FIRST_Y];
            response.spacing_mm[0] = table[SPACING_X];
            response.spacing_mm[1] = table[SPACING_Y];
            response.scale_n = table[SCALE];
            bool found = fmfts_refine(&response, b[CHANGE].buf, b[COVARIANCE].buf, steps, b[PRESS].buf, b[SPREAD].buf);
            result = PyBool_FromLong(found);
        }
    }
    for (int i = 0; i < BUFFERS; i++) {
        PyBuffer_Release(&b[i]);
    }
    return result;
}

static PyMethodDef methods[] = {
    {"refine", refine, METH_VARARGS, "The press that most likely caused a change; see refinement.py."},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_refine", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__refine(void)
{
    return PyModuleDef_Init(&definition);
}
