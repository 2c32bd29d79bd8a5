/* Variable projection: for a given position of the magnet, its moment and the ambient field are linear unknowns.
 *
 * They are solved for at each trial position, so Levenberg–Marquardt searches in three dimensions only (Kaufman's form), and a
 * start needs neither an axis nor a strength. G. Golub, V. Pereyra, "The differentiation of pseudo-inverses…", SIAM J. Numer.
 * Anal. 10 (1973) 413. Only the dipole is linear: the search's steps fit the octupole.
 */
#include "search.h"

#define SECULAR_STEPS 50
#define SETTLED 1e-14
#define HARD_CASE 1e-10
#define SWEEPS 12

/* Jacobi's method: the eigenvalues of a symmetric 3 × 3 matrix, which it overwrites; eigenvectors in the columns. */
static void eigen3(double a[3][3], double vectors[3][3])
{
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            vectors[i][j] = i == j;
        }
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        for (int p = 0; p < 2; p++) {
            for (int q = p + 1; q < 3; q++) {
                if (a[p][q] == 0.0) {
                    continue;
                }
                double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                double t = (theta >= 0.0 ? 1.0 : -1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
                double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < 3; k++) {
                    double left = a[k][p], right = a[k][q];
                    a[k][p] = c * left - s * right;
                    a[k][q] = s * left + c * right;
                }
                for (int k = 0; k < 3; k++) {
                    double left = a[p][k], right = a[q][k];
                    a[p][k] = c * left - s * right;
                    a[q][k] = s * left + c * right;
                    left = vectors[k][p], right = vectors[k][q];
                    vectors[k][p] = c * left - s * right;
                    vectors[k][q] = s * left + c * right;
                }
            }
        }
    }
}

/* The lowest minimum of µᵀAµ − 2bᵀµ over |µ| = length: (A − λ)µ = b, with λ below the eigenvalues of A.
 *
 * λ is found with Newton's method on 1/|µ(λ)|, which is nearly linear, from the side where it converges monotonically (A. Conn,
 * N. Gould, P. Toint, "Trust-Region Methods", 2000, section 7.3). Without a component along the weakest direction, both of its
 * signs are equally good: one is taken. */
static void of_length(double a[3][3], const double slope[3], double length, double moment[3])
{
    double vectors[3][3], turned[3], part[3] = {0}, square = dot3(slope, slope), size = 0.0;
    eigen3(a, vectors);
    int low = a[0][0] <= a[1][1] ? (a[0][0] <= a[2][2] ? 0 : 2) : (a[1][1] <= a[2][2] ? 1 : 2);
    for (int i = 0; i < 3; i++) {
        turned[i] = vectors[0][i] * slope[0] + vectors[1][i] * slope[1] + vectors[2][i] * slope[2];
    }
    turned[low] = copysign(fmax(fabs(turned[low]), HARD_CASE * sqrt(square)), turned[low]);
    double shift = a[low][low] - fabs(turned[low]) / length;
    for (int step = 0; step < SECULAR_STEPS; step++) {
        double stiff = 0.0;
        for (int i = 0; i < 3; i++) {
            part[i] = turned[i] / (a[i][i] - shift);
            stiff += part[i] * part[i] / (a[i][i] - shift);
        }
        size = sqrt(dot3(part, part));
        if (!(fabs(size - length) > SETTLED * length)) {
            break;
        }
        shift -= (size / length - 1.0) * size * size / stiff;
    }
    for (int i = 0; i < 3; i++) {
        moment[i] = dot3(vectors[i], part) * (length / size);
    }
}

typedef struct {
    double a[6][7]; /* moment 3, then the estimated ambient components, then the right-hand side */
    size_t uniform[3];
    size_t size;
} linear_parts;

/* Sums the normal equations of the moment and the change of the ambient field, at the state's position. */
static void collect(fmfts_pose_search *search, const double *state, linear_parts *parts)
{
    const fmfts_problem *problem = search->problem;
    size_t last = parts->size;
    for (size_t i = 0; i < last; i++) {
        for (size_t j = i; j <= last; j++) {
            parts->a[i][j] = 0.0;
        }
    }
    for (size_t r = 0; r < search->row_count; r++) {
        const fmfts_row *row = &search->rows[r];
        double column[FMFTS_MAX_COLUMNS], own[7];
        fmfts_sight sight[FMFTS_MAX_MAGNETS];
        look_all(&search->sources, row->place, sight);
        double others = sense_all(&search->sources, sight, state, row->place, row->direction, column) - column[LOG_COLUMN];
        by_moment(problem->magnets[0], sight[0].r, row->direction, own);
        for (size_t i = 3; i < last; i++) {
            own[i] = row->direction[parts->uniform[i - 3]];
        }
        own[last] = row->value - others;
        for (size_t i = 0; i < last; i++) {
            for (size_t j = i; j <= last; j++) {
                parts->a[i][j] += own[i] * own[j];
            }
        }
    }
    for (size_t i = 3; i < last; i++) {
        size_t component = parts->uniform[i - 3], c = AMBIENT_COLUMN + component;
        if (problem->parts[c] == FMFTS_PRIOR) {
            double information = 1.0 / problem->prior_covariance[c * search->columns + c];
            parts->a[i][i] += information;
            parts->a[i][last] +=
                information * (problem->prior_mean[AMBIENT_VALUE + component] - state[AMBIENT_VALUE + component]);
        }
    }
}

/* Eliminates the ambient field. left: the normal equations of the moment alone. False if the ambient is not measured. */
static bool eliminate(linear_parts *parts, fmfts_matrix ambient, fmfts_matrix work, double shared[3][4], double left[3][4])
{
    size_t count = parts->size - 3, last = parts->size;
    for (size_t i = 0; i < count; i++) {
        for (size_t j = i; j < count; j++) {
            ambient[i][j] = parts->a[3 + i][3 + j];
        }
    }
    if (!factor(count, ambient, 0.0, work)) {
        return false;
    }
    for (size_t k = 0; k < 4; k++) { /* for each moment component, then for the right-hand side */
        double solved[3];
        for (size_t i = 0; i < count; i++) {
            solved[i] = k < 3 ? parts->a[k][3 + i] : parts->a[3 + i][last];
        }
        solve_factored(count, work, solved);
        for (size_t i = 0; i < count; i++) {
            shared[i][k] = solved[i];
        }
    }
    for (size_t i = 0; i < 3; i++) {
        for (size_t k = 0; k < 4; k++) {
            left[i][k] = k == 3 ? parts->a[i][last] : parts->a[i < k ? i : k][i < k ? k : i];
            for (size_t j = 0; j < count; j++) {
                left[i][k] -= parts->a[i][3 + j] * shared[j][k];
            }
        }
    }
    return true;
}

bool fmfts_best_linear_parts(fmfts_pose_search *search, double *state)
{
    const fmfts_problem *problem = search->problem;
    linear_parts parts;
    fmfts_matrix work, normal;
    double shared[3][4], left[3][4], moment[3];
    place_sources(problem->magnets, state, &search->sources);
    parts.size = 3;
    for (size_t i = 0; i < 3; i++) {
        if (fmfts_estimated(problem->parts[AMBIENT_COLUMN + i])) {
            parts.uniform[parts.size++ - 3] = i;
        }
    }
    collect(search, state, &parts);
    if (!eliminate(&parts, normal, work, shared, left)) {
        return false;
    }
    bool length_open = fmfts_estimated(problem->parts[LOG_COLUMN]);
    double a[3][3], slope[3];
    for (int i = 0; i < 3; i++) {
        slope[i] = moment[i] = left[i][3];
        for (int j = 0; j < 3; j++) {
            a[i][j] = normal[i][j] = left[i][j];
        }
    }
    if (!length_open) {
        of_length(a, slope, fmfts_exp(state[LOG_VALUE]), moment);
    } else if (factor(3, normal, 0.0, work)) {
        solve_factored(3, work, moment);
    } else {
        return false;
    }
    double length = sqrt(dot3(moment, moment));
    if (!(length > 0.0 && length < INFINITY)) {
        return false;
    }
    for (int i = 0; i < 3; i++) {
        state[AXIS_VALUE + i] = moment[i] / length;
    }
    state[LOG_VALUE] = length_open ? fmfts_log(length) : state[LOG_VALUE];
    for (size_t i = 0; i + 3 < parts.size; i++) {
        double change = shared[i][3];
        for (int j = 0; j < 3; j++) {
            change -= shared[i][j] * moment[j];
        }
        state[AMBIENT_VALUE + parts.uniform[i]] += change;
    }
    return true;
}
