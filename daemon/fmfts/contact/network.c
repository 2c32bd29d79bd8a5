/* Computes FORWARD and BACKWARD of graph.py. Inner loops run over the hidden units, and keep sums apart in lanes: a compiler
 * can vectorise that without changing the order of any sum. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("tree-loop-vectorize") /* only for this file: the solver, also in _fast, is faster without */
#endif
#include "network.h"

#include <math.h>
#include <string.h>

enum { POSE = FMFTS_NETWORK_POSE, SCALED = FMFTS_SCALED, FEATURES = FMFTS_FEATURES, LANES = 8 };

bool fmfts_view_network(const float *vector, size_t count, fmfts_network *network)
{
    enum { HEAD = 3 };
    if (count < HEAD || !(vector[0] >= 1.0f && vector[0] <= FMFTS_MAX_HIDDEN) ||
        !(vector[1] >= 1.0f && vector[1] <= FMFTS_MAX_OUTPUTS)) {
        return false;
    }
    size_t hidden = (size_t)vector[0], outputs = (size_t)vector[1];
    const float **part[] = {&network->rest, &network->by_scale, &network->w1, &network->b1,
                            &network->w2,   &network->b2,       &network->w3, &network->b3};
    const size_t size[] = {POSE,   POSE * SCALED,    FEATURES * hidden, hidden, hidden * hidden,
                           hidden, hidden * outputs, outputs};
    const float *next = vector + HEAD;
    network->evaluate = NULL;
    network->hidden = hidden;
    network->outputs = outputs;
    network->softening = vector[2];
    for (size_t i = 0; i < sizeof size / sizeof size[0]; i++) {
        *part[i] = next;
        next += size[i];
    }
    return next == vector + count;
}

/* Lambert's continued fraction at value/4, then tanh 2x = 2 tanh x / (1 + tanh² x) twice. Beyond 9 the nearest float is ±1.
 * NaN stays NaN. */
static float tanh_of(float value)
{
    float x = (value < -9.0f ? -9.0f : value > 9.0f ? 9.0f : value) * 0.25f, square = x * x;
    float t = x * (135135.0f + square * (17325.0f + square * (378.0f + square))) /
              (135135.0f + square * (62370.0f + square * (3150.0f + square * 28.0f)));
    t = 2.0f * t / (1.0f + t * t);
    return 2.0f * t / (1.0f + t * t);
}

/* out [columns] = bias + in [rows] · weight [rows][columns] */
static void affine(size_t rows, size_t columns, const float *in, const float *weight, const float *bias, float *out)
{
    memcpy(out, bias, columns * sizeof *out);
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < columns; j++) {
            out[j] += in[i] * weight[i * columns + j];
        }
    }
}

static void activate(size_t count, float *value, float *slope)
{
    for (size_t i = 0; i < count; i++) {
        value[i] = tanh_of(value[i]);
        slope[i] = 1.0f - value[i] * value[i];
    }
}

static float dot(size_t count, const float *a, const float *b)
{
    float sum[LANES] = {0.0f};
    size_t whole = count - count % LANES;
    for (size_t i = 0; i < whole; i += LANES) {
        for (size_t lane = 0; lane < LANES; lane++) {
            sum[lane] += a[i + lane] * b[i + lane];
        }
    }
    for (size_t i = whole; i < count; i++) {
        sum[i - whole] += a[i] * b[i];
    }
    return ((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]));
}

/* feature: the scaled displacement from rest, and its direction, softened near rest. Returns its length. */
static float features_of(const fmfts_network *network, const float *pose, float feature[FEATURES])
{
    float square = 0.0f;
    for (size_t k = 0; k < SCALED; k++) {
        feature[k] = 0.0f;
        for (size_t i = 0; i < POSE; i++) {
            feature[k] += (pose[i] - network->rest[i]) * network->by_scale[i * SCALED + k];
        }
        square += feature[k] * feature[k];
    }
    float length = sqrtf(square + network->softening);
    for (size_t k = 0; k < SCALED; k++) {
        feature[SCALED + k] = feature[k] / length;
    }
    return length;
}

/* Derivatives of one output by the pose, from those by the features. */
static void chain(const fmfts_network *network, const float feature[FEATURES], float length,
                  const float by_feature[FEATURES], float by_pose[POSE])
{
    const float *direction = feature + SCALED, *by_direction = by_feature + SCALED;
    float along = 0.0f, by_scaled[SCALED];
    for (size_t k = 0; k < SCALED; k++) {
        along += by_direction[k] * direction[k];
    }
    for (size_t k = 0; k < SCALED; k++) {
        by_scaled[k] = by_feature[k] + (by_direction[k] - along * direction[k]) / length;
    }
    for (size_t i = 0; i < POSE; i++) {
        by_pose[i] = 0.0f;
        for (size_t k = 0; k < SCALED; k++) {
            by_pose[i] += by_scaled[k] * network->by_scale[i * SCALED + k];
        }
    }
}

void fmfts_infer(const fmfts_network *network, const float *pose, float *contact, float *jacobian)
{
    if (network->evaluate) {
        network->evaluate(network->context, pose, contact, jacobian);
        return;
    }
    size_t hidden = network->hidden, outputs = network->outputs;
    float feature[FEATURES], h1[FMFTS_MAX_HIDDEN], slope1[FMFTS_MAX_HIDDEN], h2[FMFTS_MAX_HIDDEN],
        slope2[FMFTS_MAX_HIDDEN], by_a2[FMFTS_MAX_HIDDEN], by_a1[FMFTS_MAX_HIDDEN], by_feature[FEATURES];
    float length = features_of(network, pose, feature);
    affine(FEATURES, hidden, feature, network->w1, network->b1, h1);
    activate(hidden, h1, slope1);
    affine(hidden, hidden, h1, network->w2, network->b2, h2);
    activate(hidden, h2, slope2);
    affine(hidden, outputs, h2, network->w3, network->b3, contact);
    for (size_t output = 0; output < outputs; output++) {
        for (size_t j = 0; j < hidden; j++) {
            by_a2[j] = network->w3[j * outputs + output] * slope2[j];
        }
        for (size_t i = 0; i < hidden; i++) {
            by_a1[i] = dot(hidden, by_a2, network->w2 + i * hidden) * slope1[i];
        }
        for (size_t f = 0; f < FEATURES; f++) {
            by_feature[f] = dot(hidden, by_a1, network->w1 + f * hidden);
        }
        chain(network, feature, length, by_feature, jacobian + output * POSE);
    }
}
