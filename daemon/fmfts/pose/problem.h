/* The problem and the solution of the solver: problem.py and state.py. SI units. Arrays are row-major. */
#ifndef FMFTS_PROBLEM_H
#define FMFTS_PROBLEM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A state as values: position 3, axis 3, log moment, ambient 3, gradient 5; then 7 for each neighbour.
 * A step as columns: position 3, tilt 2, log moment, ambient 3, gradient 5; then 6 for each neighbour.
 * There is room for the pad's own magnet and, for example, two neighbouring pads of four. */
#ifndef FMFTS_MAX_MAGNETS
#define FMFTS_MAX_MAGNETS 9
#endif
#define FMFTS_VALUES(magnets) (8 + 7 * (magnets))
#define FMFTS_COLUMNS(magnets) (8 + 6 * (magnets))
#define FMFTS_MAX_COLUMNS FMFTS_COLUMNS(FMFTS_MAX_MAGNETS)

/* A measurement: place 3, direction 3, value, noise, proportional deviation, age. A magnet: strength, octupole. */
#define FMFTS_MEASUREMENT 10
#define FMFTS_MAGNET 2
/* The number of doubles that fmfts_solve needs as work space. */
#define FMFTS_WORK(rows) (9 * (rows))

enum { FMFTS_FIXED, FMFTS_FREE, FMFTS_CONSIDERED, FMFTS_PRIOR };
typedef enum { FMFTS_CONVERGED, FMFTS_AT_LIMIT, FMFTS_UNOBSERVABLE, FMFTS_INVALID } fmfts_status;

typedef struct {
    const double *measurements; /* rows × FMFTS_MEASUREMENT */
    size_t rows;
    const double *magnets; /* magnet_count × FMFTS_MAGNET */
    size_t magnet_count;
    const uint8_t *parts;           /* columns */
    const double *start;            /* values */
    const double *prior_mean;       /* values, or NULL */
    const double *prior_covariance; /* columns × columns, or NULL */
    const double *rate;             /* columns, or NULL */
    const double *diffusion;        /* columns, or NULL */
    double stop_chi2; /* stop where a step promises to lower χ² by less than this */
    double wanted_chi2; /* give up if χ² is not below this soon; 0: never */
    double reach_m;     /* give up if the first magnet gets farther than this from the start; 0: never */
    int max_iterations;
    bool project; /* cold start: compute axis, moment and ambient from the position (projection.c) */
} fmfts_problem;

/* chi2 and residual_t are NaN without an estimate. */
typedef struct {
    fmfts_status status;
    double chi2;
    double residual_t;
    int iterations;
    size_t rows;
    size_t unknowns;
} fmfts_summary;

#endif
