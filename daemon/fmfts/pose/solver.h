/* The pose of magnets from magnetic measurements: Levenberg–Marquardt on measurements and a Gaussian prior.
 *
 * Conventions are those of problem.py and state.py. Re-entrant: no allocation, no globals. SI units. Arrays are row-major.
 */
#ifndef FMFTS_SOLVER_H
#define FMFTS_SOLVER_H

#include "problem.h"

#define FMFTS_MAX_ITERATIONS 50 /* as in problem.py */

/* Results: state [values], covariance [columns × columns], direction [columns] or NULL. work: FMFTS_WORK(rows) doubles. */
fmfts_summary fmfts_solve(const fmfts_problem *problem, double *work, double *state, double *covariance,
                          double *direction);

#endif
