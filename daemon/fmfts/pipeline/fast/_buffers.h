/* Checks the buffers that Python hands over, before C uses them. */
#ifndef FMFTS_BUFFERS_H
#define FMFTS_BUFFERS_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include "frame_step.h"

/* 0 and ValueError if the buffer has another size. */
static inline int has_size(const Py_buffer *buffer, size_t size, const char *what)
{
    if (buffer->len == (Py_ssize_t)size) {
        return 1;
    }
    PyErr_Format(PyExc_ValueError, "%s: %zd bytes, %zu expected", what, buffer->len, size);
    return 0;
}

/* 0 and ValueError if the vector is not a network with the outputs x, y and force, and perhaps two shears. */
static inline int view_network(const Py_buffer *vector, fmfts_network *network)
{
    if (fmfts_view_network(vector->buf, (size_t)vector->len / sizeof(float), network) &&
        (network->outputs == 3 || network->outputs == FMFTS_CONTACT)) {
        return 1;
    }
    PyErr_SetString(PyExc_ValueError, "network: not a network with three or five outputs");
    return 0;
}

#endif
