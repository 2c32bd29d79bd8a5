/* Two errors made on purpose: the sanitizers must end the process at each, or they would miss those of the package. */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

/* Reads the double behind the end of an array. */
static PyObject *read_behind(PyObject *module, PyObject *args)
{
    Py_buffer buffer;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*", &buffer)) {
        return NULL;
    }
    const volatile double *number = buffer.buf;
    PyObject *found = PyFloat_FromDouble(number[buffer.len / (Py_ssize_t)sizeof(double)]);
    PyBuffer_Release(&buffer);
    return found;
}

/* Adds one to an int. */
static PyObject *overflow(PyObject *module, PyObject *args)
{
    int number;
    (void)module;
    return PyArg_ParseTuple(args, "i", &number) ? PyLong_FromLong(number + 1) : NULL;
}

/* What C makes of NaN as an index. */
static PyObject *as_index(PyObject *module, PyObject *args)
{
    double number;
    (void)module;
    return PyArg_ParseTuple(args, "d", &number) ? PyLong_FromSize_t((size_t)number) : NULL;
}

static PyMethodDef methods[] = {
    {"read_behind", read_behind, METH_VARARGS, NULL},
    {"overflow", overflow, METH_VARARGS, NULL},
    {"as_index", as_index, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {.m_base = PyModuleDef_HEAD_INIT, .m_name = "wrong", .m_size = 0, .m_methods = methods};

PyMODINIT_FUNC PyInit_wrong(void)
{
    return PyModule_Create(&definition);
}
