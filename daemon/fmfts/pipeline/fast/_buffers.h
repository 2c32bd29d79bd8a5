/* Checks the buffers that Python hands over, before C uses them. */
#ifndef FMFTS_BUFFERS_H
#define FMFTS_BUFFERS_H

#define PY_SSIZE_T_CLEAN
#include "../../common/stable_abi.h"

#include <Python.h>

#include "../../common/aligned.h"
#include "frame_step.h"

/* 0 and ValueError if the buffer has another size, or begins where no double may. */
static inline int has_size(const Py_buffer *buffer, size_t size, const char *what)
{
    if (buffer->len == (Py_ssize_t)size) {
        return fmfts_is_aligned(buffer, sizeof(double));
    }
    PyErr_Format(PyExc_ValueError, "%s: %zd bytes, %zu expected", what, buffer->len, size);
    return 0;
}

/* 0 and ValueError if the vector is not a network with the outputs x, y and force, and perhaps two shears, where the pad has a
 * contact model. */
static inline int view_network(const Py_buffer *vector, const fmfts_parameters *parameters, fmfts_network *network)
{
    if (parameters->message.has_model[0] == 0.0) {
        return 1;
    }
    if (!fmfts_is_aligned(vector, sizeof(float))) {
        return 0;
    }
    if (vector->buf && fmfts_view_network(vector->buf, (size_t)vector->len / sizeof(float), network) &&
        (network->outputs == 3 || network->outputs == FMFTS_CONTACT)) {
        return 1;
    }
    PyErr_SetString(PyExc_ValueError, "network: not a network with three or five outputs");
    return 0;
}

/* What Python hands over of a pad: (parameters, memory, outcome, response, network, own sighting, neighbours' sightings …). The
 * response is a buffer as in refine.h, or None; the network a vector as in network.h, or None. */
enum {
    FMFTS_PARAMETERS_BUFFER,
    FMFTS_MEMORY_BUFFER,
    FMFTS_OUTCOME_BUFFER,
    FMFTS_RESPONSE_BUFFER,
    FMFTS_NETWORK_BUFFER,
    FMFTS_SIGHTING_BUFFERS,
    FMFTS_PAD_BUFFERS = FMFTS_SIGHTING_BUFFERS + 1 + FMFTS_NEIGHBOURS,
};

/* 0 and an exception if the tuple is not that. buffer [FMFTS_PAD_BUFFERS]: zeros, to be released in any case. */
static inline int fmfts_take_pad(PyObject *given, Py_buffer *buffer, fmfts_pad *pad)
{
    Py_buffer *b = buffer, *sighting = b + FMFTS_SIGHTING_BUFFERS;
    if (!PyArg_ParseTuple(given, "y*w*w*z*z*w*|y*y*y*y*", &b[0], &b[1], &b[2], &b[3], &b[4], &sighting[0], &sighting[1],
                          &sighting[2], &sighting[3], &sighting[4]) ||
        !has_size(&b[FMFTS_PARAMETERS_BUFFER], sizeof(fmfts_parameters), "parameters") ||
        !has_size(&b[FMFTS_MEMORY_BUFFER], sizeof(fmfts_memory), "memory") ||
        !has_size(&b[FMFTS_OUTCOME_BUFFER], sizeof(fmfts_outcome), "outcome") ||
        !fmfts_is_aligned(&b[FMFTS_RESPONSE_BUFFER], sizeof(double)) ||
        !view_network(&b[FMFTS_NETWORK_BUFFER], b[FMFTS_PARAMETERS_BUFFER].buf, &pad->network)) {
        return 0;
    }
    pad->parameters = b[FMFTS_PARAMETERS_BUFFER].buf;
    pad->response = b[FMFTS_RESPONSE_BUFFER].buf;
    pad->response_bytes = (size_t)b[FMFTS_RESPONSE_BUFFER].len;
    pad->own = sighting[0].buf;
    for (int i = 0; i <= (int)pad->parameters->pose.neighbours[0]; i++) {
        if (i > FMFTS_NEIGHBOURS || !has_size(&sighting[i], sizeof(fmfts_sighting), "sighting")) {
            return PyErr_Occurred() ? 0 : (PyErr_SetString(PyExc_ValueError, "too many neighbours"), 0);
        }
        if (i > 0) {
            pad->neighbour[i - 1] = sighting[i].buf;
        }
    }
    return 1;
}

#endif
