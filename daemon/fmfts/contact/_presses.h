/* Functions of fmfts.contact._contact; each takes arrays, in the order that its comment in _presses.c gives. */
#ifndef FMFTS_PRESSES_H
#define FMFTS_PRESSES_H

#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

PyObject *fmfts_py_respond(PyObject *module, PyObject *args);
PyObject *fmfts_py_basis(PyObject *module, PyObject *args);
PyObject *fmfts_py_refine(PyObject *module, PyObject *args);
PyObject *fmfts_py_widened(PyObject *module, PyObject *args);
PyObject *fmfts_py_pressed(PyObject *module, PyObject *args);

#endif
