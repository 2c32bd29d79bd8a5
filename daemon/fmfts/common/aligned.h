/* For a module whose Python.h is included: whether arrays of numbers have the size and the place that C expects. */
#ifndef FMFTS_ALIGNED_H
#define FMFTS_ALIGNED_H

#include <stdbool.h>
#include <stdint.h>

/* Returns whether the array begins at a multiple of `size`, that of its numbers; otherwise raises ValueError. NumPy's own
 * arrays and bytes do. A view into other bytes may not, and vector instructions can end the process there. */
static inline bool fmfts_is_aligned(const Py_buffer *buffer, size_t size)
{
    if ((uintptr_t)buffer->buf % size == 0) {
        return true;
    }
    PyErr_Format(PyExc_ValueError, "an array of numbers of %zu bytes begins at an odd address: copy it first", size);
    return false;
}

/* Whether the array has so many bytes, of numbers of `unit` bytes; otherwise raises ValueError. */
static inline bool fmfts_has_bytes(const Py_buffer *buffer, size_t bytes, size_t unit, const char *what)
{
    if ((size_t)buffer->len != bytes) {
        PyErr_Format(PyExc_ValueError, "%s: %zd bytes, %zu expected", what, buffer->len, bytes);
        return false;
    }
    return fmfts_is_aligned(buffer, unit);
}

/* Whether each of `count` arrays has so many doubles; otherwise raises ValueError that names its number. */
static inline bool fmfts_have_doubles(const Py_buffer *buffer, const size_t *doubles, int count)
{
    for (int i = 0; i < count; i++) {
        if ((size_t)buffer[i].len != doubles[i] * sizeof(double)) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zu doubles expected", i, buffer[i].len, doubles[i]);
            return false;
        }
        if (!fmfts_is_aligned(&buffer[i], sizeof(double))) {
            return false;
        }
    }
    return true;
}

static inline void fmfts_give_back(Py_buffer *buffer, int count)
{
    for (int i = 0; i < count; i++) {
        PyBuffer_Release(&buffer[i]);
    }
}

#endif
