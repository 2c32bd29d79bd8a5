/* The gate: whether a frame fits a plausible pose of the pad's magnet. */
#include "../common/chi2.h"
#include "limits.h"
#include "model.h"
#include "tracking.h"

/* A magnet that is farther from rest than this is not the pad's. */
static const double REACH_M = 8e-3;
/* A magnet becomes stronger than at its baseline only by cooling (2.4 % in 20 K) and by errors of calibration (1.3 %
 * under a press, with gains good to 5 %). Steel above it makes it look stronger and farther away: beyond 5 %, it is
 * steel. */
static const double LOG_STRONGER = 0.04879016416943205;

double fmfts_strongest(const fmfts_pose_parameters *parameters)
{
    return parameters->at_rest != 0.0 ? LOG_STRONGER : FMFTS_LOG_MOMENT_REACH; /* 0: no moment at rest */
}

bool fmfts_has_plausible_pose(const fmfts_pose_parameters *parameters, const fmfts_solved *solved, double strongest)
{
    double away_m[3], variance = 0.0, stronger = solved->state[LOG_VALUE] - parameters->rest[LOG_VALUE];
    for (int i = 0; i < 3; i++) {
        away_m[i] = solved->state[i] - parameters->rest[i];
        variance += solved->covariance[(FMFTS_STEP + 1) * i];
    }
    return solved->status == FMFTS_CONVERGED && sqrt(dot3(away_m, away_m)) < REACH_M &&
           variance < FMFTS_VAGUE_M * FMFTS_VAGUE_M && stronger > -FMFTS_LOG_MOMENT_REACH && stronger < strongest;
}

bool fmfts_fits(const fmfts_pose_parameters *parameters, const fmfts_solved *solved, double strongest)
{
    return fmfts_has_plausible_pose(parameters, solved, strongest) && solved->freedom > 0 &&
           solved->chi2 < parameters->gate_chi2[solved->freedom];
}

bool fmfts_fits_steadily(const fmfts_pose_parameters *parameters, const fmfts_solved *solved, const fmfts_misfit *misfit)
{
    return fmfts_fits(parameters, solved, fmfts_strongest(parameters)) && misfit->chi2 < parameters->gate_chi2[misfit->freedom];
}

bool fmfts_surprises(const fmfts_step *step)
{
    const fmfts_misfit *misfit = &step->misfit;
    return !misfit->known || misfit->chi2 > step->parameters->surprising_chi2[misfit->freedom];
}

double fmfts_probability(const fmfts_pose_parameters *parameters, const fmfts_solved *solved)
{
    bool is_plausible = fmfts_has_plausible_pose(parameters, solved, FMFTS_LOG_MOMENT_REACH);
    return is_plausible ? fmfts_survival(solved->chi2, solved->freedom) : 0.0;
}
