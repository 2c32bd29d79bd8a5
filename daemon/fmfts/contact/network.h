/* Evaluates the contact network of calibrate/graph.py, with its Jacobian, without onnxruntime.
 *
 * In single precision, as in the graph. The order of operations is the same on every machine and for every pose, but not
 * that of onnxruntime. Re-entrant: no allocation, no globals. Arrays are row-major.
 */
#ifndef FMFTS_NETWORK_H
#define FMFTS_NETWORK_H

#include <stdbool.h>
#include <stddef.h>

enum {
    FMFTS_NETWORK_POSE = 6,
    FMFTS_SCALED = 5,
    FMFTS_FEATURES = 2 * FMFTS_SCALED,
    FMFTS_MAX_HIDDEN = 256,
    FMFTS_MAX_OUTPUTS = 5,
};

/* Views into one vector of floats. evaluate: the function to call instead, with `context`, if the model is another
 * graph; else NULL. */
typedef struct {
    void (*evaluate)(void *context, const float *pose, float *contact, float *jacobian);
    void *context;
    size_t hidden, outputs;
    float softening;
    const float *rest;     /* [pose] */
    const float *by_scale; /* [pose][scaled] */
    const float *w1, *b1;  /* [features][hidden], [hidden] */
    const float *w2, *b2;  /* [hidden][hidden] */
    const float *w3, *b3;  /* [hidden][outputs] */
} fmfts_network;

/* vector: hidden, outputs, softening, then the arrays in the order above. False if its size does not fit. */
bool fmfts_view_network(const float *vector, size_t count, fmfts_network *network);

/* Computes contact [outputs] and jacobian [outputs][pose] at pose [pose], in the model's units. */
void fmfts_infer(const fmfts_network *network, const float *pose, float *contact, float *jacobian);

#endif
