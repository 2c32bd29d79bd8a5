/* fmfts.contact._network: network.c for Python, through the stable ABI. Only inference.py calls it. */
#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include "../common/aligned.h"
#include "network.h"

static bool are_aligned(const Py_buffer *b)
{
    return fmfts_is_aligned(&b[0], sizeof(float)) && fmfts_is_aligned(&b[1], sizeof(float)) &&
           fmfts_is_aligned(&b[2], sizeof(float)) && fmfts_is_aligned(&b[3], sizeof(float));
}

/* infer(vector, pose, contact, jacobian): all float32. ValueError if their sizes do not fit each other. */
static PyObject *infer(PyObject *module, PyObject *args)
{
    Py_buffer b[4] = {{0}};
    fmfts_network network;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*w*w*", &b[0], &b[1], &b[2], &b[3])) {
        return NULL;
    }
    const size_t pose = FMFTS_NETWORK_POSE * sizeof(float);
    if (!are_aligned(b)) {
        /* it has raised */
    } else if (b[0].len % (Py_ssize_t)sizeof(float) == 0 &&
        fmfts_view_network(b[0].buf, (size_t)b[0].len / sizeof(float), &network) && (size_t)b[1].len == pose &&
        (size_t)b[2].len == network.outputs * sizeof(float) && (size_t)b[3].len == network.outputs * pose) {
        fmfts_infer(&network, b[1].buf, b[2].buf, b[3].buf);
        result = Py_NewRef(Py_None);
    } else {
        PyErr_SetString(PyExc_ValueError, "vector, pose, contact and jacobian are not of one network");
    }
    for (int i = 0; i < 4; i++) {
        PyBuffer_Release(&b[i]);
    }
    return result;
}

static PyMethodDef methods[] = {
    {"infer", infer, METH_VARARGS, "Contact and Jacobian of one pose; see inference.py."},
    {NULL, NULL, 0, NULL},
};

static int set_constants(PyObject *module)
{
    return PyModule_AddIntConstant(module, "MAX_HIDDEN", FMFTS_MAX_HIDDEN);
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_constants},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_network", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__network(void)
{
    return PyModuleDef_Init(&definition);
}
