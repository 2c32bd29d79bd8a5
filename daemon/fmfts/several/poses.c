/* Where the magnets of a frame are: poses.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"
#include "fit.h"

enum {
    SIDE_BY_SIDE = 8, /* sums of sum_of_squares */
    MOST_CAUSES = FMFTS_SEVERAL_MOVES + 2 * FMFTS_SEVERAL_POSES,
};

_Static_assert(MOST_CAUSES <= 128, "NumPy adds up longer rows in another order");
_Static_assert(2 * FMFTS_SEVERAL_POSES <= FMFTS_SEVERAL_COLUMNS, "two matrices [V][P] do not fit into a work space's factor");

/* Σ a[i] · b[i], in the order in which NumPy adds up a row of 128 numbers and less: eight sums side by side, then the rest. */
static double sum_of_products(size_t n, const double *a, const double *b)
{
    double sum[SIDE_BY_SIDE] = {0.0}, all = 0.0;
    size_t i = 0;
    for (; i + SIDE_BY_SIDE <= n; i += SIDE_BY_SIDE) {
        for (size_t j = 0; j < SIDE_BY_SIDE; j++) {
            sum[j] += a[i + j] * b[i + j];
        }
    }
    all = ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7]));
    for (; i < n; i++) {
        all += a[i] * b[i];
    }
    return all;
}

/* What the errors of the fingers add to the covariance of two numbers. */
static double by_fingers(size_t unknowns, const double *one, const double *covariance, const double *other)
{
    double of_fingers[FMFTS_SEVERAL_UNKNOWNS];
    fmfts_product(1, unknowns, unknowns, one, covariance, of_fingers);
    return sum_of_products(unknowns, of_fingers, other);
}

/* What may move the magnets, in SI: move [count][P], and by_table [P]: the table's errors. */
typedef struct {
    size_t count;
    double move[FMFTS_SEVERAL_MOVES * FMFTS_SEVERAL_POSES], by_table[FMFTS_SEVERAL_POSES];
} moves;

/* Brings the moves from the response's units to SI, and lists B of poses.py in `all`. Returns its columns. */
static size_t list_moves(const fmfts_several *model, const double *unfelt, moves *m, double *all)
{
    size_t poses = model->poses, columns = poses + m->count + poses;
    memset(all, 0, poses * columns * sizeof(double));
    for (size_t p = 0; p < poses; p++) {
        double unit = model->head->unit[p % FMFTS_POSE_CHANGE], *row = all + p * columns;
        row[p] = unfelt[p % FMFTS_POSE_CHANGE];
        for (size_t i = 0; i < m->count; i++) {
            row[poses + i] = m->move[i * poses + p] = unit * m->move[i * poses + p];
        }
        row[poses + m->count + p] = m->by_table[p] = unit * m->by_table[p];
    }
    return columns;
}

/* told [P][used] = B (L⁻¹ P B)' of poses.py; white [used][P]: L⁻¹ P; room [used][P]. The table's errors move each number of
 * pose by itself: of their columns all else is zero. */
static void tell(size_t poses, size_t used, const moves *m, const double *white, double *room, double *told)
{
    double by_pose[FMFTS_SEVERAL_POSES * FMFTS_SEVERAL_MOVES], through[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_MOVES];
    for (size_t p = 0; p < poses; p++) {
        for (size_t i = 0; i < m->count; i++) {
            by_pose[p * m->count + i] = m->move[i * poses + p];
        }
    }
    fmfts_product(used, poses, m->count, white, by_pose, through);
    fmfts_product(used, m->count, poses, through, m->move, room);
    for (size_t p = 0; p < poses; p++) {
        for (size_t v = 0; v < used; v++) {
            told[p * used + v] = room[v * poses + p] + m->by_table[p] * (white[v * poses + p] * m->by_table[p]);
        }
    }
}

fmfts_refusal fmfts_poses_of(const fmfts_several *model, const double *unfelt, const fmfts_fitted *fitted,
                             const fmfts_measured *measured, fmfts_several_work *work, fmfts_poses *poses)
{
    enum { REST = FMFTS_SEVERAL_UNKNOWNS + 1 };
    const fmfts_fingers fingers = fitted->fingers;
    moves m;
    double rest[FMFTS_SEVERAL_VALUES * REST], explained[FMFTS_SEVERAL_POSES * REST];
    double all[FMFTS_SEVERAL_POSES * MOST_CAUSES], told[FMFTS_SEVERAL_POSES * FMFTS_SEVERAL_VALUES];
    double by_finger[FMFTS_SEVERAL_POSES * FMFTS_SEVERAL_UNKNOWNS];
    fmfts_refusal refusal = fmfts_whitener(model, fingers, measured, work);
    if (refusal.kind != FMFTS_FINE) {
        return refusal;
    }
    /* The matrix of the root is no longer needed. */
    double *white = work->factor, *room = white + FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_POSES;
    const fmfts_predicted *predicted = &work->predicted[fmfts_predict_in(model, fingers, work)];
    size_t numbers = model->poses, unknowns = FMFTS_FINGER * fingers.count, used = work->used, columns = unknowns + 1;
    for (size_t v = 0; v < used; v++) {
        size_t value = work->index[v];
        memcpy(white + v * numbers, predicted->by_pose + value * numbers, numbers * sizeof(double));
        memcpy(rest + v * columns, predicted->slope + value * unknowns, unknowns * sizeof(double));
        rest[v * columns + unknowns] = fitted->misfit_t[value];
    }
    fmfts_solve_lower(used, numbers, work->root, white);
    fmfts_solve_lower(used, columns, work->root, rest);
    m.count = fmfts_considered_moves(model, fingers, predicted, m.move);
    fmfts_response_error(model, fingers, predicted, m.by_table);
    size_t causes = list_moves(model, unfelt, &m, all);
    tell(numbers, used, &m, white, room, told);
    fmfts_product(numbers, used, columns, told, rest, explained);
    for (size_t p = 0; p < numbers; p++) {
        double unit = model->head->unit[p % FMFTS_POSE_CHANGE];
        for (size_t u = 0; u < unknowns; u++) {
            const double *slope = predicted->pressed[u / FMFTS_FINGER] + numbers + FMFTS_FINGER * p;
            by_finger[p * unknowns + u] = slope[u % FMFTS_FINGER] * unit - explained[p * columns + u];
        }
        poses->change[p] = predicted->change[p] + explained[p * columns + unknowns];
        for (size_t q = poses->covariance ? 0 : p; q <= p; q++) {
            const double *one = by_finger + p * unknowns, *other = by_finger + q * unknowns;
            double own = sum_of_products(causes, all + p * causes, all + q * causes) -
                         sum_of_products(used, told + p * used, told + q * used) +
                         by_fingers(unknowns, one, fitted->covariance, other);
            if (poses->covariance) {
                poses->covariance[p * numbers + q] = poses->covariance[q * numbers + p] = own;
            }
            poses->variance[p] = fmax(0.0, own); /* the last one is the diagonal */
        }
    }
    fmfts_moved_magnets(model, poses->change, poses->position, poses->axis);
    return refusal;
}
