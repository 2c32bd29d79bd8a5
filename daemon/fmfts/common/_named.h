/* Tells Python the fields of a struct: record.py makes a record of them. */
#ifndef FMFTS_NAMED_H
#define FMFTS_NAMED_H

#define PY_SSIZE_T_CLEAN
#include "stable_abi.h"

#include <Python.h>

#include "fields.h"

/* A list of (name, type, count). NULL and an exception if there is no memory. */
static inline PyObject *fmfts_list_of(const fmfts_field_name *field, size_t count)
{
    PyObject *fields = PyList_New(0);
    for (size_t i = 0; fields && i < count; i++) {
        PyObject *one = Py_BuildValue("(ssn)", field[i].name, field[i].type, (Py_ssize_t)field[i].count);
        if (!one || PyList_Append(fields, one) < 0) {
            Py_CLEAR(fields);
        }
        Py_XDECREF(one);
    }
    return fields;
}

#endif
