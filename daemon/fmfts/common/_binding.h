/* What every module in C shares: Python's stable ABI, functions that take arrays, and the module itself. */
#ifndef FMFTS_BINDING_H
#define FMFTS_BINDING_H

#include "_named.h" /* Python.h first: it chooses what the system's headers declare */

#include "aligned.h"

enum { FMFTS_MOST_ARRAYS = 32 };

/* Defines fmfts_py_NAME for a table of methods. Its body takes `args` into the arrays b, which are released after it. */
#define FMFTS_FUNCTION(name)                                                                                           \
    static PyObject *name##_of(Py_buffer *b, PyObject *args);                                                          \
    PyObject *fmfts_py_##name(PyObject *module, PyObject *args)                                                        \
    {                                                                                                                  \
        Py_buffer arrays[FMFTS_MOST_ARRAYS] = {{0}};                                                                   \
        PyObject *result = name##_of(arrays, args);                                                                    \
        (void)module;                                                                                                  \
        fmfts_give_back(arrays, FMFTS_MOST_ARRAYS);                                                                    \
        return result;                                                                                                 \
    }                                                                                                                  \
    static PyObject *name##_of(Py_buffer *b, PyObject *args)

/* A row of a table of methods. */
#define FMFTS_METHOD(name, text) {#name, fmfts_py_##name, METH_VARARGS, text}

/* Defines the module. set_up: adds its constants; −1 and an exception where that fails. */
#define FMFTS_MODULE(name, methods, set_up)                                                                            \
    static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)set_up}, {0, NULL}};                                      \
    static PyModuleDef definition = {                                                                                  \
        .m_base = PyModuleDef_HEAD_INIT, .m_name = #name, .m_size = 0, .m_methods = methods, .m_slots = slots};        \
    PyMODINIT_FUNC PyInit_##name(void)                                                                                 \
    {                                                                                                                  \
        return PyModuleDef_Init(&definition);                                                                          \
    }

/* Adds a list of fields to a module; −1 and an exception where that fails. */
static inline int fmfts_add_fields(PyObject *module, const char *name, const fmfts_field_name *field, size_t count)
{
    PyObject *fields = fmfts_list_of(field, count);
    int done = fields ? PyModule_AddObjectRef(module, name, fields) : -1;
    Py_XDECREF(fields);
    return done;
}

/* Whether an array has so many doubles; otherwise raises ValueError. */
static inline bool fmfts_has_doubles(const Py_buffer *buffer, size_t doubles, const char *what)
{
    return fmfts_has_bytes(buffer, doubles * sizeof(double), sizeof(double), what);
}

#endif
