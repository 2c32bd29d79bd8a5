/* The magnets of a neighbouring pad: their poses in this pad's axes, and their effect on its field. */
#ifndef FMFTS_BESIDE_H
#define FMFTS_BESIDE_H

#include <stdbool.h>
#include <stddef.h>

#include "magnets.h"
#include "pose_fields.h"

/* Where a pad's magnets were last seen, in that pad's axes: sighting.py. Pointers into its doubles, which Python owns. last, rest
 * [magnets][FMFTS_PLACED]; covariance: of a step of all; time_ns: on the host's clock, NaN: never; rest_error [magnets][2]. */
typedef struct {
    size_t magnets;
    double *last, *covariance, *time_ns, *rest, *rest_error;
} fmfts_sighting;

/* The doubles of a sighting. */
#define FMFTS_SIGHTING(magnets) \
    ((2 * FMFTS_PLACED + 2) * (magnets) + FMFTS_MOVES * FMFTS_MOVES * (magnets) * (magnets) + 1)

fmfts_sighting fmfts_view_sighting(double *doubles, size_t magnets);

/* Magnets in this pad's axes, at rest and now. covariance: of a step of all, its rows `width` doubles apart. */
typedef struct {
    double (*rest)[FMFTS_PLACED], (*now)[FMFTS_PLACED];
    double *covariance;
    size_t width;
} fmfts_seen;

/* The poses of a sighting's magnets at time_ns; the time since they were seen adds uncertainty. turn, place_m: from
 * their pad's axes to this one's. Writes all that `seen` points to. */
void fmfts_see(const double turn[9], const double place_m[3], const fmfts_sighting *sighting, double time_ns,
               const fmfts_seen *seen);

/* The field at a place, along three directions, of a magnet that is `placed`. */
void fmfts_field_of_placed(const double magnet[FMFTS_MAGNET], const double placed[FMFTS_PLACED], const double place_m[3],
                           const double direction[9], double field_t[3]);

/* The variance at one place, along each axis, from errors of a pad's placement and of a magnet's rest: a dipole's change of field
 * varies by 4/r of itself per metre. change_t: of the field there, since the magnet rested. */
double fmfts_placement_variance(const double rest_error[2], double placement_m, const double now_m[3], const double place_m[3],
                                const double change_t[3]);

/* A neighbouring pad whose magnets are considered, not solved for. Arrays are as above, of all its magnets. direction:
 * of the chips' axes. */
typedef struct {
    size_t sensors, magnets;
    const double *place_m, *direction, *magnet, *rest, *now, *rest_error, *covariance;
    double placement_m;
} fmfts_beside;

/* Its field at rest, and what has changed since, [sensors][3]; and the covariance [3·sensors]² of that. */
void fmfts_change_beside(const fmfts_beside *pad, double *rest_t, double *change_t, double *covariance_t2);

#endif
