/* _fields.c: each takes arrays, in the order that its comment gives. */
#ifndef FMFTS_KERNEL_H
#define FMFTS_KERNEL_H

#include "../common/_binding.h"

PyObject *fmfts_py_dipole(PyObject *module, PyObject *args);
PyObject *fmfts_py_move(PyObject *module, PyObject *args);
PyObject *fmfts_py_fields(PyObject *module, PyObject *args);
PyObject *fmfts_py_read(PyObject *module, PyObject *args);
PyObject *fmfts_py_deviations(PyObject *module, PyObject *args);

#endif
