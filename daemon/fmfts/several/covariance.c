/* The covariance of the predicted field: field_model.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/wide.h"
#include "gram.h"
#include "several.h"

/* sum [count] += Σ weight[i] · rows[i][count], i in order. Four rows at once: the sums stay in registers between them. */
FMFTS_WIDE static void add_rows(size_t rows, size_t count, const double *weight, const double *restrict row, double *restrict sum)
{
    size_t i = 0;
    for (; i + 4 <= rows; i += 4, row += 4 * count) {
        for (size_t j = 0; j < count; j++) {
            double here = sum[j] + weight[i] * row[j];
            here += weight[i + 1] * row[count + j];
            here += weight[i + 2] * row[2 * count + j];
            sum[j] = here + weight[i + 3] * row[3 * count + j];
        }
    }
    for (; i < rows; i++, row += count) {
        for (size_t j = 0; j < count; j++) {
            sum[j] += weight[i] * row[j];
        }
    }
}

/* Whether a magnet is elsewhere than at rest. */
static bool has_moved(size_t poses, const double *change)
{
    for (size_t p = 0; p < poses; p++) {
        if (change[p] != 0.0) {
            return true;
        }
    }
    return false;
}

/* FieldErrors.at, by causes: [causes][stride]. The part of the poses is kept with them; NULL: they have not changed, and it is zero. */
static void lasting(const fmfts_several *model, fmfts_predicted *predicted, const double ambient_t[3], double *out)
{
    double by_field[FMFTS_SEVERAL_CAUSES * FMFTS_SEVERAL_VALUES];
    size_t count = model->causes * model->stride;
    memset(by_field, 0, count * sizeof(double));
    if (predicted && predicted->known < FMFTS_WITH_LASTING) {
        memset(predicted->lasting, 0, count * sizeof(double));
        add_rows(model->poses, count, predicted->change, model->by_pose, predicted->lasting);
        predicted->known = predicted->known == FMFTS_ALL_OF_IT ? FMFTS_WITH_LASTING : predicted->known;
    }
    add_rows(3, count, ambient_t, model->by_field, by_field);
    for (size_t i = 0; i < count; i++) {
        out[i] = (predicted ? predicted->lasting[i] : 0.0) + by_field[i];
    }
}

size_t fmfts_considered_moves(const fmfts_several *model, fmfts_fingers fingers, const fmfts_predicted *predicted, double *move)
{
    size_t poses = model->poses, count = 0, places = 2 * model->magnets;
    for (size_t f = 0; f < fingers.count; f++, count += 3) {
        const double *by_shear = predicted->pressed[f] + 4 * poses, *laplacian = by_shear + 2 * poses;
        double shear_n = model->head->friction * fingers.at[FMFTS_FINGER * f + 2], wider = 0.5 * model->head->patch_mm2;
        for (size_t p = 0; p < poses; p++) {
            move[count * poses + p] = shear_n * by_shear[2 * p];
            move[(count + 1) * poses + p] = shear_n * by_shear[2 * p + 1];
            move[(count + 2) * poses + p] = wider * laplacian[p];
        }
    }
    for (size_t p = 0; p < poses; p++) {
        /* A magnet's poses go with its own place alone; all other terms of the sum are zero. */
        const double *root = model->off_root + 2 * (p / FMFTS_POSE_CHANGE) * places;
        double by_x = 0.0, by_y = 0.0;
        for (size_t f = 0; f < fingers.count; f++) {
            const double *slope = predicted->pressed[f] + poses + 3 * p;
            by_x = f ? by_x + -slope[0] : -slope[0];
            by_y = f ? by_y + -slope[1] : -slope[1];
        }
        for (size_t j = 0; j < places; j++) {
            move[(count + j) * poses + p] = 0.0 + by_x * root[j] + by_y * root[places + j];
        }
    }
    return count + places;
}

void fmfts_response_error(const fmfts_several *model, fmfts_fingers fingers, const fmfts_predicted *predicted, double *deviation)
{
    double of_table = model->head->response_error, of_sum = 0.5 * model->head->sum_error_per_n;
    for (size_t p = 0; p < model->poses; p++) {
        double variance = 0.0;
        for (size_t f = 0; f < fingers.count; f++) {
            double error = of_table * predicted->pressed[f][p];
            variance += error * error;
        }
        for (size_t i = 0; i < fingers.count; i++) {
            for (size_t j = 0; j < i; j++) {
                double both = fabs(predicted->pressed[i][p]) * fingers.at[FMFTS_FINGER * j + 2] +
                              fabs(predicted->pressed[j][p]) * fingers.at[FMFTS_FINGER * i + 2];
                double error = of_sum * both;
                variance += error * error;
            }
        }
        deviation[p] = sqrt(variance);
    }
}

/* The columns that go through the poses. Returns how many. */
static size_t through_poses(const fmfts_several *model, fmfts_fingers fingers, const fmfts_predicted *predicted,
                            fmfts_several_work *work, double *column)
{
    double move[FMFTS_SEVERAL_MOVES * FMFTS_SEVERAL_POSES], deviation[FMFTS_SEVERAL_POSES];
    size_t poses = model->poses, stride = model->stride;
    for (size_t p = 0; p < poses; p++) {
        double unit = model->head->unit[p % FMFTS_POSE_CHANGE], *row = work->by_pose + p * stride;
        for (size_t v = 0; v < model->values; v++) {
            row[v] = predicted->by_pose[v * poses + p] * unit;
        }
        memset(row + model->values, 0, (stride - model->values) * sizeof(double));
    }
    size_t count = fmfts_considered_moves(model, fingers, predicted, move);
    memset(column, 0, count * stride * sizeof(double));
    for (size_t i = 0; i < count; i++) {
        add_rows(poses, stride, move + i * poses, work->by_pose, column + i * stride);
    }
    fmfts_response_error(model, fingers, predicted, deviation);
    for (size_t p = 0; p < poses; p++) {
        for (size_t v = 0; v < stride; v++) {
            column[(count + p) * stride + v] = work->by_pose[p * stride + v] * deviation[p];
        }
    }
    return count + poses;
}

/* covariance [V][V] = factor factor', of so many columns. */
FMFTS_WIDE static void square(const fmfts_several *model, size_t columns, const double *factor, double *covariance)
{
    size_t values = model->values, stride = model->stride;
    for (size_t i = 0; i < values; i += FMFTS_LANES) {
        for (size_t j = 0; j <= i; j += FMFTS_LANES) {
            double sum[FMFTS_LANES][FMFTS_LANES];
            fmfts_gram(columns, factor + i, stride, factor + j, stride, sum);
            for (size_t a = i; a < i + FMFTS_LANES && a < values; a++) {
                for (size_t b = j; b < j + FMFTS_LANES && b < values; b++) {
                    covariance[a * values + b] = covariance[b * values + a] = sum[a - i][b - j];
                }
            }
        }
    }
}

/* The columns of the ambient field and of the moment; `field`: by how much it has changed, NULL: not. */
static void around_and_moment(const fmfts_several *model, const double *field, double *column)
{
    double *moment = column + 3 * model->stride;
    for (size_t i = 0; i < 3 * model->stride; i++) {
        column[i] = model->head->ambient_t * model->by_ambient[i];
    }
    for (size_t v = 0; v < model->stride; v++) {
        moment[v] = v < model->values ? model->head->moment * ((field ? field[v] : 0.0) + model->at_rest[v]) : 0.0;
    }
}

/* The coefficients of fmfts_at_rest: each from the covariance of a unit field along one axis, or along two. */
static void learn_rest(const fmfts_several *model, fmfts_several_work *work)
{
    static const size_t both[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    fmfts_at_rest *rest = &work->at_rest;
    size_t squares = model->values * model->values;
    around_and_moment(model, NULL, work->factor);
    square(model, 4, work->factor, rest->constant);
    for (size_t k = 0; k < 6; k++) {
        double unit[3] = {0.0, 0.0, 0.0};
        unit[k < 3 ? k : both[k - 3][0]] = unit[k < 3 ? k : both[k - 3][1]] = 1.0;
        lasting(model, NULL, unit, work->factor);
        square(model, model->causes, work->factor, rest->by_ambient[k]);
        for (size_t i = 0; k >= 3 && i < squares; i++) {
            rest->by_ambient[k][i] -= rest->by_ambient[both[k - 3][0]][i] + rest->by_ambient[both[k - 3][1]][i];
        }
    }
    rest->known = true;
}

static void covariance_at_rest(const fmfts_several *model, const double ambient_t[3], fmfts_several_work *work)
{
    const fmfts_at_rest *rest = &work->at_rest;
    double x = ambient_t[0], y = ambient_t[1], z = ambient_t[2], square_of[6] = {x * x, y * y, z * z, x * y, x * z, y * z};
    if (!rest->known) {
        learn_rest(model, work);
    }
    memcpy(work->covariance, rest->constant, model->values * model->values * sizeof(double));
    add_rows(1, model->values * model->values, square_of, rest->by_ambient[0], work->covariance);
    for (size_t k = 1; k < 6; k++) {
        add_rows(1, model->values * model->values, square_of + k, rest->by_ambient[k], work->covariance);
    }
}

void fmfts_several_covariance(const fmfts_several *model, fmfts_fingers fingers, fmfts_predicted *predicted,
                              const double *variance_t2, const double ambient_t[3], fmfts_several_work *work)
{
    size_t values = model->values, columns = 3 + 1 + model->causes;
    if (fingers.count || has_moved(model->poses, predicted->change)) {
        around_and_moment(model, predicted->field, work->factor);
        lasting(model, predicted, ambient_t, work->factor + 4 * model->stride);
        if (fingers.count) {
            columns += through_poses(model, fingers, predicted, work, work->factor + columns * model->stride);
        }
        square(model, columns, work->factor, work->covariance);
    } else {
        covariance_at_rest(model, ambient_t, work);
    }
    for (size_t v = 0; v < values; v++) {
        work->covariance[v * values + v] += variance_t2[v];
    }
}
