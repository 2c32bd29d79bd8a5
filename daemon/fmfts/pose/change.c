/* The change of pose from rest, and how uncertain it is. Contact depends on it alone, because errors of the mounting cancel in
 * it. */
#include <string.h>

#include "model.h"
#include "step.h"

/* The covariance (5, 5) of the change that the baseline's uncertainty causes. */
static void leftover_covariance(const fmfts_pose_parameters *parameters, const double *change, const double *ambient_t,
                                double covariance[5][5])
{
    int leftovers = (int)parameters->leftovers;
    double since[FMFTS_CHANGE], error[5][FMFTS_LEFTOVERS];
    for (int by = 0; by < FMFTS_CHANGE; by++) {
        since[by] = by < 5 ? change[by] : ambient_t[by - 5];
    }
    for (int i = 0; i < 5; i++) {
        for (int m = 0; m < leftovers; m++) {
            error[i][m] = 0.0;
        }
        for (int by = 0; by < FMFTS_CHANGE; by++) {
            const double *unit = parameters->change_error + (by * 5 + i) * leftovers;
            for (int m = 0; m < leftovers; m++) {
                error[i][m] += since[by] * unit[m];
            }
        }
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int m = 0; m < leftovers; m++) {
                sum += error[i][m] * error[j][m];
            }
            covariance[i][j] = covariance[j][i] = sum;
        }
    }
}

/* out = T a Tᵀ, with T (rows, 5). */
static void carry(int rows, const double transform[][5], const double a[5][5], double *out)
{
    double half[6][5];
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < 5; j++) {
            half[i][j] = 0.0;
            for (int k = 0; k < 5; k++) {
                half[i][j] += transform[i][k] * a[k][j];
            }
        }
    }
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < rows; j++) {
            double sum = 0.0;
            for (int k = 0; k < 5; k++) {
                sum += half[i][k] * transform[j][k];
            }
            out[rows * i + j] = sum;
        }
    }
}

void fmfts_change(const fmfts_pose_parameters *parameters, const double *state, double change[5])
{
    double rest[2][3];
    tangent_basis(parameters->rest + AXIS_VALUE, rest);
    for (int i = 0; i < 3; i++) {
        change[i] = state[i] - parameters->rest[i];
    }
    for (int i = 0; i < 2; i++) {
        change[3 + i] = dot3(rest[i], state + AXIS_VALUE);
    }
}

/* Computes d->change, and d->turn from the estimate's tangents to those at rest. */
static void measure(const fmfts_pose_parameters *parameters, const double *state, fmfts_displacement *d)
{
    double rest[2][3];
    tangent_basis(parameters->rest + AXIS_VALUE, rest);
    tangent_basis(state + AXIS_VALUE, d->basis);
    fmfts_change(parameters, state, d->change);
    for (int i = 0; i < 2; i++) {
        for (int j = 0; j < 2; j++) {
            d->turn[i][j] = dot3(rest[i], d->basis[j]);
        }
    }
}

/* Transforms a covariance from the rest axis's tangents to the estimate's: turned [5][5]. */
static void turn_back(const fmfts_displacement *d, const double added[5][5], double *turned)
{
    double back[5][5];
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            back[j][i] = i < 3 || j < 3 ? i == j : d->turn[i - 3][j - 3];
        }
    }
    carry(5, (const double(*)[5])back, added, turned);
}

void fmfts_widen(const fmfts_pose_parameters *parameters, const double *state, const double added[5][5], fmfts_pose *pose)
{
    double turned[25];
    fmfts_displacement d;
    measure(parameters, state, &d);
    turn_back(&d, added, turned);
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            pose->covariance[FMFTS_STEP * i + j] += turned[5 * i + j];
        }
    }
}

void fmfts_displace(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                    const fmfts_pose *pose, const double overlap[5][5], fmfts_displacement *d)
{
    double added[5][5], turned[25], to_rest[5][5];
    measure(parameters, state, d);
    leftover_covariance(parameters, d->change, state + AMBIENT_VALUE, added);
    fmfts_creep(parameters, memory, d->change, added);
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            to_rest[i][j] = i < 3 || j < 3 ? i == j : d->turn[i - 3][j - 3];
        }
    }
    turn_back(d, (const double(*)[5])added, turned);
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            double own = pose->covariance[FMFTS_STEP * i + j];
            d->covariance[i][j] = (overlap ? own - overlap[i][j] : own) + turned[5 * i + j];
        }
    }
    carry(5, (const double(*)[5])to_rest, (const double(*)[5])d->covariance, d->at_rest);
}

void fmfts_draw(const fmfts_pose_parameters *parameters, const double *state, const fmfts_displacement *d,
                double unit_per_m, double pose[6], double covariance[36])
{
    double spread[6][5] = {{0}};
    for (int i = 0; i < 3; i++) {
        const double *turn = parameters->drawn_turn + 3 * i, *back = parameters->pad_turn + 3 * i;
        pose[i] = (parameters->drawn_rest_m[i] + dot3(back, d->change)) * unit_per_m;
        pose[3 + i] = dot3(turn, state + AXIS_VALUE);
        for (int k = 0; k < 3; k++) {
            spread[i][k] = back[k] * unit_per_m;
        }
        spread[3 + i][3] = dot3(turn, d->basis[0]);
        spread[3 + i][4] = dot3(turn, d->basis[1]);
    }
    carry(6, (const double(*)[5])spread, d->covariance, covariance);
}

void fmfts_distance(const fmfts_displacement *d, double *moved_m, double *deviation_m)
{
    double square = dot3(d->change, d->change), along = 0.0, largest = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            along += d->change[i] * d->at_rest[5 * i + j] * d->change[j];
        }
        largest = fmax(largest, d->at_rest[6 * i]);
    }
    *moved_m = sqrt(square);
    *deviation_m = sqrt(fmax(square > 0.0 ? along / square : largest, 0.0));
}
