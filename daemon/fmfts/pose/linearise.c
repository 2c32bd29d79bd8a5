/* χ² at a state, with its gradient and curvature. */
#include "search.h"

enum { TOGETHER = 3 }; /* rows summed at a time: the three of a sensor, for a third of the loads and stores */

/* What the rows of one place share, and the derivatives of the last one. */
typedef struct {
    fmfts_sight sight[FMFTS_MAX_MAGNETS];
    double column[FMFTS_MAX_COLUMNS];
} fmfts_view;

/* own: one row of J, then its residual. Returns the residual in tesla. n: search->ordered. */
FMFTS_INLINE double sense_row(size_t n, const fmfts_pose_search *search, const double *state, const fmfts_row *row,
                              fmfts_view *view, double *own)
{
    if (row->shares_place == 0.0) {
        look_all(&search->sources, row->place, view->sight);
    }
    own[n] = row->value - sense_all(&search->sources, view->sight, state, row->place, row->direction, view->column);
    for (size_t i = 0; i < n; i++) {
        own[i] = view->column[search->order[i]];
    }
    return own[n] * row->deviation;
}

/* Sums JᵀJ, Jᵀρ and ρᵀρ as outer products of rows of J that end with their residual. n: search->ordered. */
FMFTS_INLINE void add_rows(size_t n, const fmfts_pose_search *search, const double *state, fmfts_linear *out)
{
    double own[TOGETHER][FMFTS_STRIDE];
    fmfts_view view;
    out->raw_square = 0.0;
    fmfts_fill(view.column, search->columns, 0.0);
    for (size_t i = 0; i <= n; i++) {
        for (size_t j = i; j <= n; j++) {
            out->a[i][j] = 0.0;
        }
    }
    for (size_t first = 0; first < search->row_count; first += TOGETHER) {
        for (size_t r = 0; r < TOGETHER; r++) {
            if (first + r < search->row_count) {
                double raw = sense_row(n, search, state, &search->rows[first + r], &view, own[r]);
                out->raw_square += raw * raw;
            } else {
                fmfts_fill(own[r], n + 1, 0.0);
            }
        }
        for (size_t i = 0; i <= n; i++) {
            for (size_t j = i; j <= n; j++) {
                out->a[i][j] += own[0][i] * own[0][j] + own[1][i] * own[1][j] + own[2][i] * own[2][j];
            }
        }
    }
}

/* away: the step from the prior's mean; of an axis a, with the mean's axis m and its tangent basis T, d = Tᵀa/(a·m).
 * turn: the derivative of each magnet's two tilts. False if an axis is 90° or more from the mean's. */
static bool step_from_mean(const fmfts_pose_search *search, const double *state, double *away, double turn[][2][2])
{
    const double *mean = search->problem->prior_mean;
    for (int i = 0; i < GRADIENT_COLUMN + 5 - AMBIENT_COLUMN; i++) {
        away[AMBIENT_COLUMN + i] = state[AMBIENT_VALUE + i] - mean[AMBIENT_VALUE + i];
    }
    for (size_t m = 0; m < search->sources.count; m++) {
        const double *own = state + first_value(m), *from = mean + first_value(m);
        double *step = away + first_column(m);
        const double(*basis)[3] = (const double(*)[3])search->sources.source[m].basis;
        double origin[2][3];
        tangent_basis(from + AXIS_VALUE, origin);
        for (int i = 0; i < 3; i++) {
            step[i] = own[i] - from[i];
        }
        step[LOG_COLUMN] = own[LOG_VALUE] - from[LOG_VALUE];
        uint8_t part = search->problem->parts[first_column(m) + TILT_COLUMN];
        if (part == FMFTS_FREE || part == FMFTS_FIXED) {
            step[TILT_COLUMN] = step[TILT_COLUMN + 1] = 0.0; /* an axis without a prior may be any distance away */
            turn[m][0][0] = turn[m][1][1] = 1.0;
            turn[m][0][1] = turn[m][1][0] = 0.0;
            continue;
        }
        double along = dot3(own + AXIS_VALUE, from + AXIS_VALUE);
        if (!(along > 0.0)) {
            return false;
        }
        for (int i = 0; i < 2; i++) {
            step[TILT_COLUMN + i] = dot3(origin[i], own + AXIS_VALUE) / along;
            for (int j = 0; j < 2; j++) {
                turn[m][i][j] = (dot3(origin[i], basis[j]) - step[TILT_COLUMN + i] * dot3(from + AXIS_VALUE, basis[j])) / along;
            }
        }
    }
    return true;
}

/* Adds DᵀΩD, −DᵀΩd and dᵀΩd. False if an axis is 90° or more from the mean's. */
static bool add_prior(const fmfts_pose_search *search, const double *state, fmfts_linear *out)
{
    size_t n = search->ordered;
    double away[FMFTS_MAX_COLUMNS], turn[FMFTS_MAX_MAGNETS][2][2], pull[FMFTS_STRIDE];
    fmfts_matrix turned;
    if (!step_from_mean(search, state, away, turn)) {
        return false;
    }
    for (size_t i = 0; i < n; i++) {
        pull[i] = 0.0;
        for (size_t j = 0; j < n; j++) {
            turned[i][j] = search->information[i][j];
            pull[i] += turned[i][j] * away[search->order[j]];
        }
        out->a[n][n] += away[search->order[i]] * pull[i];
    }
    for (size_t p = 0; p + 1 < n; p++) {
        for (size_t m = 0; m < search->sources.count; m++) {
            if (search->order[p] != first_column(m) + TILT_COLUMN) {
                continue;
            }
            double first = pull[p], second = pull[p + 1];
            pull[p] = first * turn[m][0][0] + second * turn[m][1][0];
            pull[p + 1] = first * turn[m][0][1] + second * turn[m][1][1];
            for (size_t i = 0; i < n; i++) {
                first = turned[i][p], second = turned[i][p + 1];
                turned[i][p] = first * turn[m][0][0] + second * turn[m][1][0];
                turned[i][p + 1] = first * turn[m][0][1] + second * turn[m][1][1];
            }
            for (size_t i = 0; i < n; i++) {
                first = turned[p][i], second = turned[p + 1][i];
                turned[p][i] = first * turn[m][0][0] + second * turn[m][1][0];
                turned[p + 1][i] = first * turn[m][0][1] + second * turn[m][1][1];
            }
        }
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = i; j < n; j++) {
            out->a[i][j] += turned[i][j];
        }
        out->a[i][n] -= pull[i];
    }
    return true;
}

double fmfts_linearise(fmfts_pose_search *search, const double *state, fmfts_linear *out)
{
    size_t n = search->ordered;
    place_sources(search->problem->magnets, state, &search->sources);
    switch (n) { /* the compiler unrolls constant sizes: twice as fast */
    case 5:
        add_rows(5, search, state, out);
        break;
    case 6:
        add_rows(6, search, state, out);
        break;
    case 8:
        add_rows(8, search, state, out);
        break;
    case 9:
        add_rows(9, search, state, out);
        break;
    case 14:
        add_rows(14, search, state, out);
        break;
    default:
        add_rows(n, search, state, out);
    }
    if (search->has_prior && !add_prior(search, state, out)) {
        return INFINITY;
    }
    double trace = 0.0;
    for (size_t i = 0; i < n; i++) {
        trace += out->a[i][i];
    }
    return isfinite(out->a[n][n]) && isfinite(trace) ? out->a[n][n] : INFINITY;
}
