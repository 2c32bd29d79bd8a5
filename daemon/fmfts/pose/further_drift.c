/* Offsets that drift further with the temperature than the chip's figure says, which no data sheet has: told from a fault by the
 * mean residual, counted in every deviation (alignment.c), and forgotten where less explains the mean again. */
#include "mean_residuals.h"

/* Once, 2 or 4 times as much: the variance, without the figure's own. */
static const double FURTHER[] = {0.0, 2.0 * 2.0 - 1.0, 4.0 * 4.0 - 1.0};
enum { FIGURES = sizeof FURTHER / sizeof FURTHER[0], CALM_JUDGEMENTS = 275 /* 10 s at 220 Hz */ };

double fmfts_drift_t2(const fmfts_step *step)
{
    double per_k = step->parameters->offset_t_per_k, warmed = step->memory->warmed_k;
    return (per_k * per_k + step->memory->further_drift) * warmed * warmed;
}

double fmfts_hidden_drift_share(const fmfts_step *step)
{
    double per_k = step->parameters->offset_t_per_k, warmed = step->memory->warmed_k, least_t2 = INFINITY;
    double more = FURTHER[FIGURES - 1] * per_k * per_k - step->memory->further_drift;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        least_t2 = step->verdict.used[axis] ? fmin(least_t2, step->field.variance_t2[axis]) : least_t2;
    }
    return fabs(warmed) > FMFTS_WARMED_K ? more * warmed * warmed / least_t2 : 0.0;
}

static void let_drift(fmfts_step *step, double further, double added_t2)
{
    fmfts_pose_memory *memory = step->memory;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        memory->lasting_t2[axis] += added_t2;
    }
    memory->further_drift = further;
    memory->calm_drift = 0;
}

/* Whether a further drift explains a mean that is not that of healthy sensors. A fault of this size hides as well: one deviation is up
 * to 4·offset_t_per_k·warmed_k, 0.4 µT for 10 nT/K and 10 K, and one axis may be off by 3 µT then. A pad that warms on hides more. */
bool fmfts_drifts_further(fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2)
{
    double per_k = step->parameters->offset_t_per_k, warmed = step->memory->warmed_k;
    for (int i = 1; i < FIGURES; i++) {
        double further = FURTHER[i] * per_k * per_k, added_t2 = (further - step->memory->further_drift) * warmed * warmed;
        if (added_t2 > 0.0 && fmfts_explains_mean(step, common, own_t2, added_t2)) {
            let_drift(step, further, added_t2);
            return true;
        }
    }
    return false;
}

/* The further drift falls to the next smaller figure when that has explained the mean for 10 s: a fault that ended had hidden as drift.
 * Only where the mean can tell: near the temperature of the rest the difference is below a quarter of a frame's noise. */
void fmfts_drifts_less(fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2)
{
    fmfts_pose_memory *memory = step->memory;
    double per_k = step->parameters->offset_t_per_k, warmed = memory->warmed_k, less = 0.0;
    for (int i = 0; i < FIGURES && FURTHER[i] * per_k * per_k < memory->further_drift; i++) {
        less = FURTHER[i] * per_k * per_k;
    }
    double added_t2 = (less - memory->further_drift) * warmed * warmed;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        double noise_t = step->parameters->noise_t[axis];
        if (-added_t2 < noise_t * noise_t / 16.0 || !(own_t2[axis] + added_t2 > 0.0)) {
            return; /* an axis without a value, too */
        }
    }
    memory->calm_drift = fmfts_explains_mean(step, common, own_t2, added_t2) ? memory->calm_drift + 1 : 0;
    if (memory->calm_drift >= CALM_JUDGEMENTS) {
        let_drift(step, less, added_t2);
    }
}
