/* The resultant of several fingers, and its deviation: with w the share of a finger, ∂x/∂x_k = w_k, ∂x/∂F_k = (x_k − x)/F. */
#include "resultant.h"

#include <math.h>

enum { FINGER = FMFTS_OF_FINGER };

static const double LEAST_FORCE_N = 1e-9;

/* What is not a number stays so. */
static double above(double value, double least)
{
    return value < least ? least : value;
}

void fmfts_resultant(size_t count, const double *finger, double whole[FINGER])
{
    whole[0] = whole[1] = whole[2] = 0.0;
    for (size_t f = 0; f < count; f++, finger += FINGER) {
        whole[0] += finger[0] * finger[2];
        whole[1] += finger[1] * finger[2];
        whole[2] += finger[2];
    }
    whole[0] /= above(whole[2], LEAST_FORCE_N);
    whole[1] /= above(whole[2], LEAST_FORCE_N);
}

/* The derivative of number `axis` of the resultant by number i of finger f. */
static double slope_of(const double *finger, const double *whole, size_t axis, size_t f, size_t i)
{
    const double *own = finger + FINGER * f, force = above(whole[2], LEAST_FORCE_N);
    if (axis == 2) {
        return i == 2 ? 1.0 : 0.0;
    }
    return i == axis ? own[2] / force : i == 2 ? (own[axis] - whole[axis]) / force : 0.0;
}

static double resultant_variance(size_t count, const double *finger, const double *covariance, const double *whole, size_t axis)
{
    size_t unknowns = FINGER * count;
    double variance = 0.0;
    for (size_t i = 0; i < unknowns; i++) {
        for (size_t j = 0; j < unknowns; j++) {
            double both = slope_of(finger, whole, axis, i / FINGER, i % FINGER) * slope_of(finger, whole, axis, j / FINGER, j % FINGER);
            variance += both * covariance[unknowns * i + j];
        }
    }
    return variance;
}

void fmfts_finger_deviations(size_t count, const double *finger, const double *covariance, const double *least, double *deviation)
{
    size_t unknowns = FINGER * count;
    double whole[FINGER];
    fmfts_resultant(count, finger, whole);
    for (size_t i = 0; i < unknowns; i++) {
        deviation[FINGER + i] = covariance[(unknowns + 1) * i];
    }
    for (size_t axis = 0; axis < FINGER; axis++) {
        deviation[axis] = count == 1 ? deviation[FINGER + axis] : resultant_variance(count, finger, covariance, whole, axis);
    }
    for (size_t i = 0; i < FINGER + unknowns; i++) {
        deviation[i] = sqrt(above(deviation[i], least ? above(least[i], 0.0) : 0.0));
    }
}
