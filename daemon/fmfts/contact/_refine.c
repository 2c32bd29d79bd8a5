/* fmfts.contact._refine: refine.c for Python, through the stable ABI. Only refinement.py calls it, and makes the arrays. */
#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include "../common/aligned.h"
#include "refine.h"

enum { RESPONSE, CHANGE, COVARIANCE, PRESS, SPREAD, BUFFERS };

static int sizes_agree(const Py_buffer *buffer, const fmfts_response *response)
{
    size_t press = 2 + response->loads;
    const size_t wanted[BUFFERS] = {
        [RESPONSE] = (size_t)buffer[RESPONSE].len,
        [CHANGE] = FMFTS_MOVED * sizeof(double),
        [COVARIANCE] = FMFTS_MOVED * FMFTS_MOVED * sizeof(double),
        [PRESS] = press * sizeof(double),
        [SPREAD] = press * press * sizeof(double),
    };
    for (int i = 0; i < BUFFERS; i++) {
        if ((size_t)buffer[i].len != wanted[i]) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zd expected", i, buffer[i].len, wanted[i]);
            return 0;
        }
        if (!fmfts_is_aligned(&buffer[i], sizeof(double))) {
            return 0;
        }
    }
    return 1;
}

/* refine(response, change, covariance, steps, press, spread): as fmfts_refine. False if the covariance is not one. */
static PyObject *refine(PyObject *module, PyObject *args)
{
    int steps;
    Py_buffer b[BUFFERS] = {0};
    fmfts_response response;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*y*iw*w*", &b[RESPONSE], &b[CHANGE], &b[COVARIANCE], &steps, &b[PRESS], &b[SPREAD])) {
        return NULL;
    }
    if (!fmfts_is_aligned(&b[RESPONSE], sizeof(double))) {
        /* it has raised */
    } else if (!fmfts_view_response(b[RESPONSE].buf, (size_t)b[RESPONSE].len, &response)) {
        PyErr_SetString(PyExc_ValueError, "the response has another size than can be refined with");
    } else if (sizes_agree(b, &response)) {
        result = PyBool_FromLong(
            fmfts_refine(&response, b[CHANGE].buf, b[COVARIANCE].buf, steps, b[PRESS].buf, b[SPREAD].buf));
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
