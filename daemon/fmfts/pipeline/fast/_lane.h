/* What Python sees of lane.h: a Lane for each pad, and the Loop that lets frames pass while it waits. */
#ifndef FMFTS_LANE_H
#define FMFTS_LANE_H

#include "_buffers.h"
#include "lane.h"

extern PyType_Spec fmfts_lane_spec, fmfts_loop_spec;

/* The type made of fmfts_lane_spec. */
extern PyTypeObject *fmfts_lane_type;

typedef struct {
    const void *topic;
    size_t topic_bytes;
    fmfts_lane lane;
} fmfts_published_lane;

/* Of a Lane; NULL and TypeError of anything else, ValueError of one that was not begun. */
fmfts_published_lane *fmfts_lane_of(PyObject *object);

#endif
