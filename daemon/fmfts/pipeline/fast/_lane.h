/* lane.h for Python: a Lane for each pad, and a Loop that waits for bytes and lets the lanes handle them. */
#ifndef FMFTS_LANE_H
#define FMFTS_LANE_H

#include "_buffers.h"
#include "lane.h"

extern PyType_Spec fmfts_lane_spec, fmfts_loop_spec;

/* The Python type that fmfts_lane_spec describes. */
extern PyTypeObject *fmfts_lane_type;

typedef struct {
    const void *topic;
    size_t topic_bytes;
    bool is_unsent; /* its last message is one of the bus's unsent ones */
    fmfts_lane lane;
} fmfts_published_lane;

/* The lane of a Lane object. NULL and TypeError if it is another object, ValueError if it was not begun. */
fmfts_published_lane *fmfts_lane_of(PyObject *object);

#endif
