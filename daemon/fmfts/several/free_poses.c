/* The poses of all magnets by the field alone: free_poses.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"
#include "fit.h"

enum { MOST = FMFTS_SEVERAL_POSES };

static double within(const fmfts_free_limits *limits, size_t p, double value)
{
    double farthest = limits->farthest[p % FMFTS_POSE_CHANGE];
    double raised = -farthest > value ? -farthest : value;
    return farthest < raised ? farthest : raised;
}

static double floor_of(const fmfts_free_limits *limits, size_t p)
{
    double farthest = limits->farthest[p % FMFTS_POSE_CHANGE];
    return 1.0 / (farthest * farthest);
}

/* counted [P]: the change that the baseline's errors go with; _counted of free_poses.py. */
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

/* What magnets that have moved do to the field. */
static void look(const fmfts_several *model, double half_a_press_m, const double *change, fmfts_predicted *predicted)
{
    count_change(model, half_a_press_m, change, predicted->change);
    fmfts_fields(model, change, predicted->field, predicted->by_pose);
    for (size_t v = 0; v < model->values; v++) {
        predicted->field[v] -= model->at_rest[v];
    }
}

/* The root of C there, what is white of the residual, and χ². False where a matrix is refused. */
static bool weigh(const fmfts_several *model, const fmfts_predicted *here, const fmfts_measured *measured,
                  const double *ambient_t, fmfts_several_work *work, double *chi2, fmfts_refusal *refusal)
{
    if (!fmfts_root_of(model, 0, NULL, here, measured, ambient_t, work, refusal)) {
        return false;
    }
    *chi2 = fmfts_whiten(work, work->root, measured, here->field, work->white);
    return true;
}

/* normal [P][P] = J'C⁻¹J, right [P] = J'C⁻¹r. What the root came of is no longer needed: J is made white there. */
static void normal_equations(const fmfts_several *model, const fmfts_predicted *here, fmfts_several_work *work,
                             double *normal, double *right)
{
    size_t poses = model->poses, used = work->used;
    double *slope = work->factor, *across = slope + FMFTS_SEVERAL_VALUES * MOST;
    for (size_t v = 0; v < used; v++) {
        memcpy(slope + v * poses, here->by_pose + work->index[v] * poses, poses * sizeof(double));
    }
    fmfts_solve_lower(used, poses, work->root, slope);
    for (size_t v = 0; v < used; v++) {
        for (size_t p = 0; p < poses; p++) {
            across[p * used + v] = slope[v * poses + p];
        }
    }
    fmfts_product(poses, used, poses, across, slope, normal);
    fmfts_product(poses, used, 1, across, work->white, right);
}

/* trial: where a damped step from `change` leads. normal and step, its right side, are overwritten. */
static bool step_from(const fmfts_free_limits *limits, size_t poses, const double *change, double damping, double *normal,
                      double *step, double *diagonal, double *trial, fmfts_refusal *refusal)
{
    for (size_t p = 0; p < poses; p++) {
        diagonal[p] = normal[p * poses + p];
        normal[p * poses + p] += damping * diagonal[p] + floor_of(limits, p);
    }
    if (!fmfts_factored(poses, normal, refusal)) {
        return false;
    }
    fmfts_solve_lower(poses, 1, normal, step);
    fmfts_solve_lower_transposed(poses, 1, normal, step);
    for (size_t p = 0; p < poses; p++) {
        trial[p] = within(limits, p, change[p] + step[p]);
    }
    return true;
}

/* The covariance [P][P] of the poses. */
static bool spread(const fmfts_free_limits *limits, size_t poses, double *normal, double *covariance, fmfts_refusal *refusal)
{
    double half[MOST * MOST], across[MOST * MOST];
    for (size_t p = 0; p < poses; p++) {
        normal[p * poses + p] += floor_of(limits, p);
        for (size_t q = 0; q < poses; q++) {
            half[p * poses + q] = p == q ? 1.0 : 0.0;
        }
    }
    if (!fmfts_factored(poses, normal, refusal)) {
        return false;
    }
    fmfts_solve_lower(poses, poses, normal, half);
    for (size_t p = 0; p < poses; p++) {
        for (size_t q = 0; q < poses; q++) {
            across[p * poses + q] = half[q * poses + p];
        }
    }
    fmfts_product(poses, poses, poses, across, half, covariance);
    return true;
}

/* How far a step goes, in deviations of each number by itself. */
static double length_of(size_t poses, const double *from, const double *to, const double *diagonal)
{
    double longest = 0.0;
    for (size_t p = 0; p < poses; p++) {
        double moved = fabs((to[p] - from[p]) * sqrt(diagonal[p]));
        longest = moved > longest ? moved : longest;
    }
    return longest;
}

static const fmfts_predicted *descend(const fmfts_several *model, const fmfts_free_limits *limits,
                                      const fmfts_measured *measured, const double *ambient_t, fmfts_several_work *work,
                                      fmfts_free_poses *found, fmfts_refusal *refusal)
{
    double normal[MOST * MOST], step[MOST], diagonal[MOST], trial[MOST], after[FMFTS_SEVERAL_VALUES];
    double damping = limits->damping, *change = found->change, *chi2 = &found->chi2;
    fmfts_predicted *here = &work->predicted[0], *there = &work->predicted[1];
    size_t poses = model->poses;
    look(model, limits->half_a_press_m, change, here);
    if (!weigh(model, here, measured, ambient_t, work, chi2, refusal)) {
        return NULL;
    }
    for (size_t i = 0; i < (size_t)limits->iterations; i++) {
        normal_equations(model, here, work, normal, step);
        if (!step_from(limits, poses, change, damping, normal, step, diagonal, trial, refusal)) {
            return NULL;
        }
        look(model, limits->half_a_press_m, trial, there);
        if (fmfts_whiten(work, work->root, measured, there->field, after) > *chi2 * (1.0 + limits->rounding)) {
            damping *= limits->damping_factor;
            if (damping > limits->most_damping) {
                break;
            }
            continue;
        }
        double length = length_of(poses, change, trial, diagonal);
        memcpy(change, trial, poses * sizeof(double));
        fmfts_predicted *before = here;
        here = there;
        there = before;
        damping /= limits->damping_factor;
        if (!weigh(model, here, measured, ambient_t, work, chi2, refusal)) {
            return NULL;
        }
        if (length < limits->settled) {
            break;
        }
    }
    return here;
}

fmfts_refusal fmfts_free_poses_of(const fmfts_several *model, const fmfts_free_limits *limits, const double *start,
                                  const fmfts_measured *measured, const double *ambient_t, fmfts_several_work *work,
                                  fmfts_free_poses *found)
{
    double normal[MOST * MOST], unused[MOST];
    fmfts_refusal refusal = {FMFTS_NOT_FINITE, 0};
    if (!fmfts_list_used(model->values, measured, work) || !fmfts_finite(model->poses, start) ||
        !fmfts_finite(3, ambient_t)) {
        return refusal;
    }
    refusal.kind = FMFTS_FINE;
    for (size_t p = 0; p < model->poses; p++) {
        found->change[p] = within(limits, p, start[p]);
    }
    const fmfts_predicted *at = descend(model, limits, measured, ambient_t, work, found, &refusal);
    if (!at) {
        return refusal;
    }
    normal_equations(model, at, work, normal, unused);
    if (!spread(limits, model->poses, normal, found->covariance, &refusal)) {
        return refusal;
    }
    fmfts_ambient_of(model, work, found->ambient_t);
    for (size_t v = 0; v < model->values; v++) {
        found->misfit_t[v] = measured->field_t[v] - at->field[v];
    }
    for (size_t magnet = 0; magnet < model->magnets; magnet++) {
        fmfts_moved_magnet(model, magnet, found->change, found->position + 3 * magnet, found->axis + 3 * magnet);
    }
    return refusal;
}
