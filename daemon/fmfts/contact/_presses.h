/* _presses.c: each takes arrays, in the order that its comment gives. */
#ifndef FMFTS_PRESSES_H
#define FMFTS_PRESSES_H

#include "../common/_binding.h"

PyObject *fmfts_py_respond(PyObject *module, PyObject *args);
PyObject *fmfts_py_basis(PyObject *module, PyObject *args);
PyObject *fmfts_py_refine(PyObject *module, PyObject *args);
PyObject *fmfts_py_widened(PyObject *module, PyObject *args);
PyObject *fmfts_py_pressed(PyObject *module, PyObject *args);

#endif
