/* For a module whose Python.h is included: whether arrays of numbers begin where C may read numbers. */
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

#endif
