/* Tries all places of a grid, and all pairs of them: scan.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"
#include "../arithmetic/wide.h"
#include "fit.h"
#include "gram.h"

/* One scan. white [panels][used][FMFTS_PANEL]: the templates L⁻¹·t. along, size, best [padded]: of each place, its template's
 * product with the measured field and with itself, and the most that it gains together with a place after it. */
typedef struct {
    const fmfts_search *search;
    const double *white;
    size_t used;
    double *along, *size, *best;
    size_t other[FMFTS_SEVERAL_PLACES + FMFTS_PANEL]; /* the place after it with that gain */
    size_t starts, start[FMFTS_SEVERAL_STARTS][2];    /* the pairs that are found */
} scan;

bool fmfts_white_templates(const fmfts_grid *grid)
{
    const fmfts_search *search = grid->search;
    fmfts_several_work *work = grid->work;
    double *white = grid->room;
    if (!fmfts_list_used(search->values, grid->measured, work) || !fmfts_finite(work->used * work->used, grid->root)) {
        return false;
    }
    for (size_t panel = 0; panel < search->panels; panel++, white += work->used * FMFTS_PANEL) {
        const double *from = search->template_t + panel * search->values * FMFTS_PANEL;
        for (size_t i = 0; i < work->used; i++) {
            memcpy(white + i * FMFTS_PANEL, from + work->index[i] * FMFTS_PANEL, FMFTS_PANEL * sizeof(double));
        }
        fmfts_solve_lower(work->used, FMFTS_PANEL, grid->root, white);
    }
    return true;
}

/* Fills white, along and size. False where a value that there is, or the root, is not finite. */
static bool begin(scan *s, const fmfts_grid *grid)
{
    const fmfts_search *search = grid->search;
    fmfts_several_work *work = grid->work;
    double *room = grid->room;
    if (!fmfts_white_templates(grid)) {
        return false;
    }
    size_t used = work->used, padded = search->panels * FMFTS_PANEL;
    s->search = search;
    s->white = room;
    s->used = used;
    s->along = room + used * padded;
    s->size = s->along + padded;
    s->best = s->size + padded;
    s->starts = 0;
    for (size_t i = 0; i < used; i++) {
        work->white[i] = grid->measured->field_t[work->index[i]];
    }
    fmfts_solve_lower(used, 1, grid->root, work->white);
    memset(s->along, 0, 2 * padded * sizeof(double));
    for (size_t panel = 0; panel < search->panels; panel++) {
        const double *white = room + panel * used * FMFTS_PANEL;
        double *along = s->along + panel * FMFTS_PANEL, *size = s->size + panel * FMFTS_PANEL;
        for (size_t i = 0; i < used; i++) {
            for (size_t j = 0; j < FMFTS_PANEL; j++) {
                double one = white[i * FMFTS_PANEL + j];
                along[j] += one * work->white[i];
                size[j] += one * one;
            }
        }
    }
    return true;
}

static void put_finger(const fmfts_search *search, size_t place, double share, double *finger)
{
    finger[0] = search->x_mm[place];
    finger[1] = search->y_mm[place];
    finger[2] = search->head->force_n * share;
}

bool fmfts_best_single(const fmfts_grid *grid, double *finger, double *gain)
{
    const fmfts_search *search = grid->search;
    scan s;
    size_t best = 0;
    if (!begin(&s, grid)) {
        return false;
    }
    *gain = -1.0;
    for (size_t i = 0; i < search->places; i++) {
        double size = s.size[i] > 0.0 ? s.size[i] : 1.0;
        double here = s.along[i] > 0.0 ? s.along[i] * s.along[i] / size : 0.0;
        if (here > *gain) {
            *gain = here;
            best = i;
        }
    }
    put_finger(search, best, s.along[best] / (s.size[best] > 0.0 ? s.size[best] : 1.0), finger);
    return true;
}

static double squared(double value)
{
    return value * value;
}

/* The least squares of two templates: what each finger has, times `determinant`. */
typedef struct {
    double first, second, determinant;
} pair;

static inline pair together(const scan *s, size_t i, size_t j, double cross)
{
    return (pair){
        .first = s->along[i] * s->size[j] - s->along[j] * cross,
        .second = s->along[j] * s->size[i] - s->along[i] * cross,
        .determinant = s->size[i] * s->size[j] - cross * cross,
    };
}

static const double *panel_of(const scan *s, size_t place)
{
    return s->white + place / FMFTS_PANEL * s->used * FMFTS_PANEL + place % FMFTS_PANEL;
}

static inline void crosses(const scan *s, size_t i, size_t j, double cross[FMFTS_LANES][FMFTS_LANES])
{
    fmfts_gram(s->used, panel_of(s, i), FMFTS_PANEL, panel_of(s, j), FMFTS_PANEL, cross);
}

/* Whether a pair is near a found one. */
static bool taken(const scan *s, size_t i, size_t j)
{
    const fmfts_search *search = s->search;
    for (size_t n = 0; n < s->starts; n++) {
        double farthest = fabs(search->x_mm[i] - search->x_mm[s->start[n][0]]);
        farthest = fmax(farthest, fabs(search->y_mm[i] - search->y_mm[s->start[n][0]]));
        farthest = fmax(farthest, fabs(search->x_mm[j] - search->x_mm[s->start[n][1]]));
        farthest = fmax(farthest, fabs(search->y_mm[j] - search->y_mm[s->start[n][1]]));
        if (!(farthest > search->head->near_mm)) {
            return true;
        }
    }
    return false;
}

/* Fills best and other of the FMFTS_LANES places from `first` on. */
FMFTS_WIDE static void best_of_rows(scan *s, size_t first)
{
    const fmfts_search *search = s->search;
    double apart = squared(search->head->apart_mm);
    for (size_t i = first; i < first + FMFTS_LANES; i++) {
        s->best[i] = 0.0;
    }
    for (size_t from = first; from < search->places; from += FMFTS_LANES) {
        double cross[FMFTS_LANES][FMFTS_LANES], gain[FMFTS_LANES][FMFTS_LANES];
        crosses(s, first, from, cross);
        for (size_t a = 0; a < FMFTS_LANES; a++) {
            for (size_t b = 0; b < FMFTS_LANES; b++) {
                size_t i = first + a, j = from + b;
                pair p = together(s, i, j, cross[a][b]);
                double distance = squared(search->x_mm[i] - search->x_mm[j]) + squared(search->y_mm[i] - search->y_mm[j]);
                bool good = (p.first > 0.0) & (p.second > 0.0) & (p.determinant > 0.0) & (distance >= apart) & (i < j);
                double whole = p.first * s->along[i] + p.second * s->along[j];
                gain[a][b] = good ? whole / p.determinant : 0.0;
            }
        }
        for (size_t a = 0; a < FMFTS_LANES; a++) {
            for (size_t b = 0; b < FMFTS_LANES; b++) {
                if (gain[a][b] > s->best[first + a] && !taken(s, first + a, from + b)) {
                    s->best[first + a] = gain[a][b];
                    s->other[first + a] = from + b;
                }
            }
        }
    }
}

/* The best pair that is left, the first of equals. False if none gains. */
static bool best_pair(const scan *s, size_t found[2])
{
    double most = 0.0;
    for (size_t i = 0; i < s->search->places; i++) {
        if (s->best[i] > most) {
            most = s->best[i];
            found[0] = i;
            found[1] = s->other[i];
        }
    }
    return most > 0.0;
}

bool fmfts_best_pairs(const fmfts_grid *grid, size_t most, double *starts, size_t *count)
{
    const fmfts_search *search = grid->search;
    scan s;
    if (!begin(&s, grid)) {
        return false;
    }
    for (size_t i = 0; i < search->places; i += FMFTS_LANES) {
        best_of_rows(&s, i);
    }
    size_t found[2] = {0, 0};
    while (s.starts < most && best_pair(&s, found)) {
        double cross[FMFTS_LANES][FMFTS_LANES];
        size_t one = found[0] / FMFTS_LANES * FMFTS_LANES, other = found[1] / FMFTS_LANES * FMFTS_LANES;
        crosses(&s, one, other, cross);
        pair p = together(&s, found[0], found[1], cross[found[0] - one][found[1] - other]);
        put_finger(search, found[0], p.first / p.determinant, starts + 2 * FMFTS_FINGER * s.starts);
        put_finger(search, found[1], p.second / p.determinant, starts + 2 * FMFTS_FINGER * s.starts + FMFTS_FINGER);
        memcpy(s.start[s.starts++], found, sizeof found);
        /* Places near a found pair are excluded: other pairs become the best ones. */
        for (size_t i = 0; i < search->places; i += FMFTS_LANES) {
            for (size_t j = i; j < i + FMFTS_LANES; j++) {
                if (s.best[j] > 0.0 && taken(&s, j, s.other[j])) {
                    best_of_rows(&s, i);
                    break;
                }
            }
        }
    }
    *count = s.starts;
    return true;
}
