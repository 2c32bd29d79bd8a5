/* Touched or not, and what the contact model is to be asked: change.py, touch.py and ContactModel.estimate. */
#include <math.h>
#include <string.h>

#include "../pose/model.h"
#include "../pipeline/fast/tables.h"

#define MM_PER_M 1e3

/* The magnet's change of pose from rest: position, and the axis in the rest axis's tangent plane. turn (2, 2): from the
 * estimate's tangents to those at rest. */
typedef struct {
    double change[5];
    double basis[2][3];
    double turn[2][2];
} displacement;

static void displace(const fmfts_facts *facts, const double *state, displacement *d)
{
    double rest[2][3];
    tangent_basis(facts->rest + AXIS_VALUE, rest);
    tangent_basis(state + AXIS_VALUE, d->basis);
    for (int i = 0; i < 3; i++) {
        d->change[i] = state[i] - facts->rest[i];
    }
    for (int i = 0; i < 2; i++) {
        d->change[3 + i] = dot3(rest[i], state + AXIS_VALUE);
        for (int j = 0; j < 2; j++) {
            d->turn[i][j] = dot3(rest[i], d->basis[j]);
        }
    }
}

/* What mounting left open makes of the change, as a covariance (5, 5) of it. */
static void mistaken(const fmfts_facts *facts, const double *change, double covariance[5][5])
{
    int leftovers = (int)facts->leftovers[0];
    double error[5][FMFTS_LEFTOVERS];
    for (int i = 0; i < 5; i++) {
        for (int m = 0; m < leftovers; m++) {
            error[i][m] = 0.0;
        }
        for (int by = 0; by < 5; by++) {
            const double *unit = facts->change_error + (by * 5 + i) * leftovers;
            for (int m = 0; m < leftovers; m++) {
                error[i][m] += change[by] * unit[m];
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
static void carry(int rows, const double transform[][5], double a[5][5], double *out)
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

/* The pose's own covariance (5, 5) and what mounting adds to it; `to_rest`: from its tangents to those at rest. */
static void widen(const fmfts_facts *facts, const displacement *d, const double *own, double covariance[5][5],
                  double to_rest[5][5])
{
    double added[5][5], turned[25], back[5][5] = {{0}};
    mistaken(facts, d->change, added);
    memset(to_rest, 0, 25 * sizeof(double));
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            to_rest[i][j] = i < 3 || j < 3 ? i == j : d->turn[i - 3][j - 3];
        }
    }
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            back[i][j] = to_rest[j][i];
        }
    }
    carry(5, (const double(*)[5])back, added, turned);
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            covariance[i][j] = own[FMFTS_STEP * i + j] + turned[5 * i + j];
        }
    }
}

/* χ² of the change; false where the covariance is none. */
static bool chi2_of(const double *change, const double *covariance, double *chi2)
{
    fmfts_matrix a, work;
    double solved[5];
    for (size_t i = 0; i < 5; i++) {
        solved[i] = change[i];
        for (size_t j = i; j < 5; j++) {
            a[i][j] = covariance[5 * i + j];
        }
    }
    if (!factor(5, a, 0.0, work)) {
        return false;
    }
    solve_factored(5, work, solved);
    *chi2 = 0.0;
    for (int i = 0; i < 5; i++) {
        *chi2 += change[i] * solved[i];
    }
    return isfinite(*chi2);
}

static void follow_touch(const fmfts_facts *facts, fmfts_memory *memory, double chi2)
{
    memory->quiet_frames[0] = chi2 < facts->release_chi2[0] ? memory->quiet_frames[0] + 1.0 : 0.0;
    if (chi2 > facts->onset_chi2[0]) {
        memory->touched[0] = 1.0;
    } else if (memory->quiet_frames[0] >= facts->release_frames[0]) {
        memory->touched[0] = 0.0;
    }
}

/* The change of pose put on the drawing's rest, in the model's units. */
static void draw(const fmfts_facts *facts, const double *state, const displacement *d, double covariance[5][5],
                 fmfts_question *question)
{
    double spread[6][5] = {{0}};
    for (int i = 0; i < 3; i++) {
        const double *turn = facts->drawn_turn + 3 * i;
        question->pose[i] = (facts->drawn_rest_m[i] + d->change[i]) * MM_PER_M;
        question->pose[3 + i] = dot3(turn, state + AXIS_VALUE);
        spread[i][i] = MM_PER_M;
        spread[3 + i][3] = dot3(turn, d->basis[0]);
        spread[3 + i][4] = dot3(turn, d->basis[1]);
    }
    carry(6, (const double(*)[5])spread, covariance, question->covariance);
}

/* Keeps the question inside what the model was trained on. False where the magnet is lifted, which no press does. */
static bool keep_inside(const fmfts_facts *facts, fmfts_question *question)
{
    double slack[6];
    question->share = 1.0;
    for (int i = 0; i < 6; i++) {
        slack[i] = facts->outside_deviations[0] * sqrt(fmax(question->covariance[7 * i], 0.0));
        double moved = question->pose[i] - facts->model_rest[i];
        double edge = moved > 0.0 ? facts->highest[i] + slack[i] : facts->lowest[i] - slack[i];
        if (fabs(moved) > 1e-9) {
            question->share = fmin(question->share, (edge - facts->model_rest[i]) / moved);
        }
    }
    double certain = facts->lifted_deviations[0] * slack[2] / facts->outside_deviations[0];
    if (!(question->pose[2] - facts->lifted_above_mm[0] - certain <= 0.0)) {
        return false;
    }
    question->pose[2] = fmin(question->pose[2], facts->trained_top_mm[0]);
    if (question->share < 1.0) {
        for (int i = 0; i < 6; i++) {
            question->pose[i] = facts->model_rest[i] + question->share * (question->pose[i] - facts->model_rest[i]);
        }
        for (int i = 0; i < 36; i++) {
            question->covariance[i] *= question->share * question->share;
        }
    }
    return true;
}

static void tell_pose(const fmfts_facts *facts, const double *state, const fmfts_pose *pose,
                      fmfts_numbers *n)
{
    const double *own = pose->covariance;
    double deviation[6];
    for (int i = 0; i < 6; i++) {
        deviation[i] = sqrt(own[(FMFTS_STEP + 1) * i] + facts->rest_variance[i]);
    }
    for (int i = 0; i < 3; i++) {
        int c = AMBIENT_COLUMN + i;
        n->position_m[i] = state[i];
        n->position_sd_m[i] = deviation[i];
        n->axis[i] = state[AXIS_VALUE + i];
        n->ambient_t[i] = facts->ambient_t[i] + state[AMBIENT_VALUE + i];
        n->ambient_sd_t[i] = sqrt(facts->ambient_variance[i] + own[(FMFTS_STEP + 1) * c]);
    }
    n->axis_sd_rad[0] = fmax(deviation[3], deviation[4]);
    n->remanence_t[0] = facts->remanence_t[0] * fmfts_exp(state[LOG_VALUE]);
    n->remanence_sd_t[0] = deviation[5] * n->remanence_t[0];
    n->residual_t[0] = pose->residual_t;
    n->chi2[0] = pose->chi2;
}

bool fmfts_ask(const fmfts_facts *facts, fmfts_memory *memory, const fmfts_pose *pose, fmfts_question *question,
               fmfts_numbers *numbers)
{
    displacement d;
    double covariance[5][5], to_rest[5][5], of_change[25], chi2;
    displace(facts, memory->state, &d);
    widen(facts, &d, pose->covariance, covariance, to_rest);
    carry(5, (const double(*)[5])to_rest, covariance, of_change);
    if (!chi2_of(d.change, of_change, &chi2)) {
        return false;
    }
    follow_touch(facts, memory, chi2);
    question->touching = memory->touched[0];
    draw(facts, memory->state, &d, covariance, question);
    tell_pose(facts, memory->state, pose, numbers);
    return keep_inside(facts, question);
}
