/* fmfts.pose._kernel: the C of this room that is called before the first frame, through the stable ABI. */
#ifndef FMFTS_KERNEL_H
#define FMFTS_KERNEL_H

#define PY_SSIZE_T_CLEAN
#include "../common/stable_abi.h"

#include <Python.h>

#include "../common/aligned.h"

/* _fields.c: each takes arrays, in the order that its comment gives. */
PyObject *fmfts_py_dipole(PyObject *module, PyObject *args);
PyObject *fmfts_py_move(PyObject *module, PyObject *args);
PyObject *fmfts_py_fields(PyObject *module, PyObject *args);
PyObject *fmfts_py_read(PyObject *module, PyObject *args);
PyObject *fmfts_py_deviations(PyObject *module, PyObject *args);

#endif
