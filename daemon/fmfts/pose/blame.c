/* Blames a sensor, or a foreign field, for mean residuals that are not those of healthy sensors.
 *
 * An explanation is a set of patterns F of errors, whose sizes are normal with deviation 1. With R of mean_residuals.h, the
 * mean m then has this log evidence, and this χ² that the explanation leaves:
 *     misfit = mᵀRm − (FᵀRm)ᵀ(I + FᵀRF)⁻¹FᵀRm,   log evidence = −(misfit + log det(I + FᵀRF))/2
 */
#include <string.h>

#include "foreign_field.h"
#include "mean_residuals.h"

/* An explanation needs this share of the probability to become the answer. */
#define CLEAR 0.999
/* Prior deviation of a broken axis: as wide as an error that the gate of one frame may let through. */
#define AXIS_FAULT_T 1e-5

enum { PATTERNS = FMFTS_STEP - AMBIENT_COLUMN, EXPLANATIONS = FMFTS_AXES + FMFTS_SENSORS + 1 };

/* Patterns in tesla of the judged axes, one deviation each. sensor: the faulty one; negative: none. */
typedef struct {
    int sensor;
    size_t count;
    double pattern[PATTERNS][FMFTS_AXES];
} cause;

typedef struct {
    int sensor;
    double log_evidence, misfit, probability;
} explanation;

/* The mean to explain. by_mean: R times the mean. */
typedef struct {
    size_t axes;
    double weight[FMFTS_AXES][FMFTS_AXES], by_mean[FMFTS_AXES], chi2; /* R, Rm, mᵀRm */
} problem;

static void weigh_all(fmfts_judged_axes *judged, const double *mean_t, problem *p)
{
    p->axes = judged->axes;
    p->chi2 = 0.0;
    for (size_t i = 0; i < p->axes; i++) {
        double unit[FMFTS_AXES] = {0};
        unit[i] = 1.0;
        fmfts_weigh(judged, unit, p->weight[i]);
    }
    for (size_t i = 0; i < p->axes; i++) {
        p->by_mean[i] = 0.0;
        for (size_t j = 0; j < p->axes; j++) {
            p->by_mean[i] += p->weight[i][j] * mean_t[j];
        }
        p->chi2 += mean_t[i] * p->by_mean[i];
    }
}

static explanation evidence_of(const problem *p, const cause *from)
{
    fmfts_matrix spread, factored;
    double seen[PATTERNS], solved[PATTERNS], misfit = p->chi2, log_determinant = 0.0;
    for (size_t k = 0; k < from->count; k++) {
        double weighed[FMFTS_AXES];
        seen[k] = 0.0;
        for (size_t i = 0; i < p->axes; i++) {
            seen[k] += from->pattern[k][i] * p->by_mean[i];
            weighed[i] = 0.0;
            for (size_t j = 0; j < p->axes; j++) {
                weighed[i] += p->weight[i][j] * from->pattern[k][j];
            }
        }
        for (size_t l = k; l < from->count; l++) {
            spread[k][l] = k == l ? 1.0 : 0.0;
            for (size_t i = 0; i < p->axes; i++) {
                spread[k][l] += from->pattern[l][i] * weighed[i];
            }
        }
        solved[k] = seen[k];
    }
    if (!factor(from->count, spread, 0.0, factored)) {
        return (explanation){from->sensor, -INFINITY, INFINITY, 0.0};
    }
    solve_factored(from->count, factored, solved);
    for (size_t k = 0; k < from->count; k++) {
        misfit -= seen[k] * solved[k];
        log_determinant -= fmfts_log(factored[k][k]); /* one over the pivot */
    }
    return (explanation){from->sensor, -0.5 * (misfit + log_determinant), misfit, 0.0};
}

/* Lists the explanations: each axis, each whole sensor, and a foreign field, parts of which the scene's model holds
 * fixed. Returns their number. */
static size_t explain_all(const fmfts_step *step, const fmfts_judged_axes *judged, const problem *p, explanation *each)
{
    size_t count = 0;
    cause one;
    for (size_t i = 0; i < judged->axes; i++) {
        one = (cause){.sensor = judged->axis[i] / 3, .count = 1};
        one.pattern[0][i] = AXIS_FAULT_T;
        each[count++] = evidence_of(p, &one);
    }
    for (int sensor = 0; sensor < (int)step->parameters->sensors; sensor++) {
        one = (cause){.sensor = sensor};
        for (size_t i = 0; i < judged->axes; i++) {
            if (judged->axis[i] / 3 == sensor) {
                one.pattern[one.count++][i] = AXIS_FAULT_T;
            }
        }
        if (one.count) {
            each[count++] = evidence_of(p, &one);
        }
    }
    one = (cause){.sensor = -1};
    for (int c = AMBIENT_COLUMN; c < FMFTS_STEP; c++) {
        double deviation = c < GRADIENT_COLUMN ? FMFTS_FOREIGN_UNIFORM_T : FMFTS_FOREIGN_GRADIENT_T_PER_M;
        for (size_t i = 0; step->parameters->part[c] == FMFTS_FIXED && i < judged->axes; i++) {
            one.pattern[one.count][i] = deviation * step->slopes[judged->axis[i]][c];
        }
        one.count += step->parameters->part[c] == FMFTS_FIXED;
    }
    each[count++] = evidence_of(p, &one);
    return count;
}

/* Computes the probabilities. Returns the most probable explanation, and the total probability of explanations by the
 * same sensor. */
static const explanation *most_probable(explanation *each, size_t count, double *held)
{
    double sum = 0.0, most = -INFINITY;
    const explanation *best = each;
    for (size_t i = 0; i < count; i++) {
        most = fmax(most, each[i].log_evidence);
    }
    for (size_t i = 0; i < count; i++) {
        each[i].probability = fmfts_exp(each[i].log_evidence - most);
        sum += each[i].probability;
        best = each[i].probability > best->probability ? &each[i] : best;
    }
    *held = 0.0;
    for (size_t i = 0; i < count; i++) {
        each[i].probability /= sum;
        *held += each[i].sensor == best->sensor ? each[i].probability : 0.0;
    }
    return best;
}

fmfts_finding fmfts_blame(const fmfts_step *step, fmfts_judged_axes *judged, const double *mean_t)
{
    problem p;
    explanation each[EXPLANATIONS];
    fmfts_finding found = {.is_wrong = true, .sensor = -1};
    double held;
    weigh_all(judged, mean_t, &p);
    size_t count = explain_all(step, judged, &p, each);
    const explanation *best = most_probable(each, count, &held);
    bool fits = best->misfit < step->parameters->alarm_chi2[judged->axes - judged->unknowns];
    if (fits && held > CLEAR) {
        found.sensor = best->sensor;
        found.foreign = best->sensor < 0;
        return found;
    }
    for (size_t i = 0; i < count; i++) {
        if (each[i].probability > 1.0 - CLEAR && each[i].sensor >= 0) {
            found.suspects |= 1u << each[i].sensor;
        }
    }
    found.foreign = !fits || !found.suspects;
    return found;
}
