/* The poses of all magnets by the field alone: free_poses.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"
#include "fit.h"

enum { MOST = FMFTS_SEVERAL_POSES };

/* counted [P]: the change to which the baseline's errors are proportional. They are computed for a magnet that is half
 * a press down. On its way down by d it is d/2 nearer to the chips on average, and the slope of a dipole's gradient
 * goes with r⁻⁵. */
static void count_change(const fmfts_several *model, double half_a_press_m, const double *change, double *counted)
{
    double base_m = 0.0;
    for (size_t sensor = 0; sensor < model->sensors; sensor++) {
        base_m += model->place[3 * sensor + 2];
    }
    base_m /= (double)model->sensors;
    for (size_t magnet = 0; magnet < model->magnets; magnet++) {
        const double *own = change + FMFTS_POSE_CHANGE * magnet;
        double above_m = model->position[3 * magnet + 2] - base_m, down_m = 0.0 < own[2] ? 0.0 : own[2];
        double there_m = above_m + 0.5 * down_m, least_m = 0.25 * above_m;
        double nearer = (above_m - half_a_press_m) / (least_m > there_m ? least_m : there_m), square = nearer * nearer;
        for (size_t i = 0; i < FMFTS_POSE_CHANGE; i++) {
            counted[FMFTS_POSE_CHANGE * magnet + i] = own[i] * (square * square * nearer);
        }
    }
}

/* The field of magnets that have moved. */
static void predict(const fmfts_valued *valued, const double *change, fmfts_predicted *predicted)
{
    const fmfts_several *model = valued->model;
    predicted->known = FMFTS_NOTHING;
    count_change(model, valued->limits->half_a_press_m, change, predicted->change);
    fmfts_changed_field(model, change, predicted->field, predicted->by_pose);
}

/* Moves `found` to the minimum, with its covariance. Returns what is predicted there, NULL where a matrix is refused. */
static const fmfts_predicted *descend(fmfts_valued *valued, fmfts_free_poses *found)
{
    const fmfts_free_limits *limits = valued->limits;
    double lowest[MOST], highest[MOST], floor[MOST], normal[MOST * MOST], unused[MOST], room[FMFTS_DESCENT_ROOM(MOST)];
    fmfts_descent search = {
        .unknowns = valued->model->poses,
        .iterations = (size_t)limits->iterations,
        .settled = limits->settled,
        .rounding = limits->rounding,
        .damping = limits->damping,
        .damping_factor = limits->damping_factor,
        .most_damping = limits->most_damping,
        .lowest = lowest,
        .highest = highest,
        .floor = floor,
    };
    for (size_t p = 0; p < search.unknowns; p++) {
        highest[p] = limits->farthest[p % FMFTS_POSE_CHANGE];
        lowest[p] = -highest[p];
        floor[p] = 1.0 / (highest[p] * highest[p]);
        found->change[p] = fmfts_within(found->change[p], lowest[p], highest[p]);
    }
    if (!fmfts_find_minimum(valued, &search, found->change, &found->chi2)) {
        return NULL;
    }
    fmfts_normal_equations(valued->work, search.unknowns, valued->slope, normal, unused);
    if (!fmfts_spread_of(search.unknowns, floor, normal, found->covariance, room)) {
        valued->refusal = (fmfts_refusal){FMFTS_INDEFINITE, search.unknowns};
        return NULL;
    }
    return valued->here;
}

fmfts_refusal fmfts_free_poses_of(const fmfts_several *model, const fmfts_free_limits *limits, const double *start,
                                  const fmfts_measured *measured, fmfts_several_work *work, fmfts_free_poses *found)
{
    fmfts_valued valued = {
        .model = model,
        .limits = limits,
        .measured = measured,
        .work = work,
        .slope = work->factor, /* the matrix of the root is no longer needed */
        .predict = predict,
    };
    if (!fmfts_list_used(model->values, measured, work) || !fmfts_finite(model->poses, start) ||
        !fmfts_finite(3, measured->ambient_t)) {
        return (fmfts_refusal){FMFTS_NOT_FINITE, 0};
    }
    memcpy(found->change, start, model->poses * sizeof(double));
    const fmfts_predicted *at = descend(&valued, found);
    if (!at) {
        return valued.refusal;
    }
    fmfts_ambient_of(model, work, found->ambient_t);
    for (size_t v = 0; v < model->values; v++) {
        found->misfit_t[v] = measured->field_t[v] - at->field[v];
    }
    memcpy(found->by_pose, at->by_pose, model->values * model->poses * sizeof(double));
    memcpy(found->counted, at->change, model->poses * sizeof(double));
    fmfts_moved_magnets(model, found->change, found->position, found->axis);
    return valued.refusal;
}
