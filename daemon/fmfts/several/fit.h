/* The search for the fingers that best explain a field: fit.c and scan.c. */
#ifndef FMFTS_SEVERAL_FIT_H
#define FMFTS_SEVERAL_FIT_H

#include "../arithmetic/descent.h"
#include "several.h"

enum { FMFTS_PANEL = 16 }; /* number of grid places in a panel: with all values, it fits into L1 */

/* The numbers at the head of a packed search: fit.py, scan.py. */
#define FMFTS_SEARCH_HEAD(ONE, MANY)                                                                                   \
    ONE(double, iterations)                                                                                            \
    ONE(double, stale)                                                                                                 \
    ONE(double, settled)                                                                                               \
    ONE(double, rounding)                                                                                              \
    ONE(double, damping)                                                                                               \
    ONE(double, damping_factor)                                                                                        \
    ONE(double, most_damping)                                                                                          \
    ONE(double, longest_step_mm)                                                                                       \
    ONE(double, least_step_mm)                                                                                         \
    MANY(double, lowest, FMFTS_FINGER)                                                                                 \
    MANY(double, highest, FMFTS_FINGER)                                                                                \
    MANY(double, floor, FMFTS_FINGER)                                                                                  \
    ONE(double, places)                                                                                                \
    ONE(double, force_n)                                                                                               \
    ONE(double, apart_mm)                                                                                              \
    ONE(double, near_mm)                                                                                               \
    ONE(double, least)                                                                                                 \
    ONE(double, together_mm)                                                                                           \
    ONE(double, release_deviations)                                                                                    \
    ONE(double, edge_mm)                                                                                               \
    ONE(double, certain_deviations)

FMFTS_STRUCT(fmfts_search_head, FMFTS_SEARCH_HEAD)

/* Views into one packed search. Places are padded to whole panels, with templates of zeros. */
typedef struct {
    const fmfts_search_head *head;
    size_t places, panels, values;
    const double *x_mm, *y_mm;  /* [panels · FMFTS_PANEL] */
    const double *template_t;   /* [panels][values][FMFTS_PANEL]: the effect of a press at each place on the field */
} fmfts_search;

/* As Measured; all but `used` may be NULL where they are not asked for. Arrays of all values; used: 1 where there is one.
 * foreign_t2 [values][values], NULL: none. ambient_t [3]: the ambient field. */
typedef struct {
    const double *field_t, *variance_t2;
    const uint8_t *used;
    const double *foreign_t2, *ambient_t;
} fmfts_measured;

/* Of Fit. */
enum { FMFTS_UNDETERMINED = 1, FMFTS_DOUBTFUL = 2, FMFTS_BEYOND = 4 };

/* As Fit; the caller provides the arrays. flags: of those above. */
typedef struct {
    int flags;
    double *fingers, *covariance, *misfit_t, *ambient_t, *shear_n, *shear_deviation_n, *noise_t, *slope_t;
    double chi2;
} fmfts_found;

/* Reason for no result. size: of the matrix. */
typedef struct {
    enum { FMFTS_FINE, FMFTS_NOT_FINITE, FMFTS_INDEFINITE, FMFTS_INFINITE } kind;
    size_t size;
} fmfts_refusal;

/* Room for the scan: white templates [panels][used][FMFTS_PANEL], then for each place its projection, its square, and the
 * best gain with another place. */
#define FMFTS_SCAN_DOUBLES(values, padded) (((values) + 3) * (padded))

/* packed.c: false if `packed` is no search for fields of this many values, or too large. */
bool fmfts_view_search(const double *packed, size_t count, size_t values, fmfts_search *search);

/* whitener.c: lists the present values in `work`. False if one of them is not finite. */
bool fmfts_list_used(size_t values, const fmfts_measured *measured, fmfts_several_work *work);

/* whitener.c: overwrites a [n][n] with its lower triangle. False, with the reason, if there is none. */
bool fmfts_factored(size_t n, double *a, fmfts_refusal *refusal);

/* whitener.c: work->root [used][used], the lower triangle of C at these fingers. False as above. */
bool fmfts_root_of(const fmfts_several *model, fmfts_fingers fingers, fmfts_predicted *predicted,
                   const fmfts_measured *measured, fmfts_several_work *work, fmfts_refusal *refusal);

/* whitener.c: what the root at these fingers is of; not known if other pads' magnets are in it, too. */
void fmfts_note_root(const fmfts_several *model, fmfts_fingers fingers, const fmfts_measured *measured, const fmfts_several_work *work,
                     fmfts_rooted *rooted);

/* whitener.c: white [used] = L⁻¹ · (measured − predicted). Returns its square, χ². */
double fmfts_whiten(const fmfts_several_work *work, const double *root, const fmfts_measured *measured,
                    const double *predicted_t, double *white);

/* whitener.c: white [used][unknowns] = L⁻¹ · slope [values][unknowns], of the root in `work`. */
void fmfts_whiten_slope(const double *slope, size_t unknowns, const fmfts_several_work *work, double *white);

/* What fit.c and free_poses.c search: fingers, or, with 0 of them, poses. slope: room for the white one [used][unknowns]. limits:
 * of fmfts_free_poses_of. */
typedef struct fmfts_valued {
    const fmfts_several *model;
    const struct fmfts_free_limits *limits;
    const fmfts_search *search;
    const fmfts_measured *measured;
    fmfts_several_work *work;
    size_t fingers;
    double *slope;
    void (*predict)(const struct fmfts_valued *valued, const double *at, fmfts_predicted *predicted);
    fmfts_predicted *here, *there; /* at the accepted point, and the last trial; at the start `here` is NULL */
    double weighed_at[FMFTS_SEVERAL_POSES], stale; /* where the covariance is from; how far that may be, in deviations */
    fmfts_refusal refusal;
} fmfts_valued;

/* descend.c: moves `at` to the minimum near it. Sets valued->refusal, and returns false, where a matrix is refused.
 * Else the prediction there is in valued->here, and the white slope and residual are in `work`. */
bool fmfts_find_minimum(fmfts_valued *valued, fmfts_descent *search, double *at, double *chi2);

/* descend.c: normal [n][n] and right [n] of the white slope and residual. */
void fmfts_normal_equations(const fmfts_several_work *work, size_t n, const double *slope, double *normal, double *right);

/* fit.c: right [n] = slope' · white, and the covariance [n][n] of the fingers, from the white arrays in `work`. False,
 * and it is infinite, if the values do not determine them. */
bool fmfts_spread(const fmfts_search *search, size_t n, const fmfts_several_work *work, double *right, double *covariance);

/* fit.c: ambient [3] = σ² · (L⁻¹ A)' · white: the most likely ambient field, given the residual in `work`. */
void fmfts_ambient_of(const fmfts_several *model, const fmfts_several_work *work, double *ambient);

/* fit.c: noise_t [values] = R · C⁻¹ · misfit: what the residual most likely has of noise alone, of what is in `work`. Zero of values
 * that there are not. */
void fmfts_noise_of(size_t values, const fmfts_measured *measured, const fmfts_several_work *work, double *noise_t);

/* shear.c: shear_n and deviation_n [fingers][2], from what fmfts_several_fit left in `work`. */
void fmfts_shear_of(const fmfts_several *model, fmfts_fingers fingers, const double *covariance, const fmfts_several_work *work,
                    double *shear_n, double *deviation_n);

/* fit.c */
fmfts_refusal fmfts_several_fit(const fmfts_several *model, const fmfts_search *search, fmfts_fingers start,
                                const fmfts_measured *measured, fmfts_several_work *work, fmfts_found *found);

/* whitener.c: as fmfts_root_of, with the prediction for these fingers; does nothing where the root already is of them. */
fmfts_refusal fmfts_whitener(const fmfts_several *model, fmfts_fingers fingers, const fmfts_measured *measured,
                             fmfts_several_work *work);

fmfts_refusal fmfts_chi2_with(const fmfts_several *model, const double *root, fmfts_fingers fingers,
                              const fmfts_measured *measured, fmfts_several_work *work, double *chi2);

/* Of Fit: covariance [3·fingers][3·fingers], misfit_t [values]. */
typedef struct {
    fmfts_fingers fingers;
    const double *covariance, *misfit_t;
    double chi2;
} fmfts_fitted;

/* As Fitter. */
typedef struct {
    const fmfts_several *model;
    const fmfts_search *search;
    fmfts_several_work *work;
} fmfts_fitter;

/* valley.py's LIMITS. */
typedef struct {
    double steps, least_force_n, away, farthest, flat, least_rise, unsure_mm;
} fmfts_valley_limits;

/* ways: fingers that are uncertain. least [1 + fingers][3]: variances. */
typedef struct {
    size_t ways;
    double *least;
} fmfts_valley_found;

/* valley.c: misfit_t is not needed. */
fmfts_refusal fmfts_valley(const fmfts_fitter *fitter, const fmfts_fitted *fitted, const fmfts_measured *measured,
                           const fmfts_valley_limits *limits, fmfts_valley_found *found);

/* As Poses, and position and axis [magnets][3] after the change; the caller provides the arrays. covariance: NULL: not asked for. */
typedef struct {
    double *change, *position, *axis, *variance, *covariance; /* [P], [magnets][3], [magnets][3], [P], [P][P] */
} fmfts_poses;

/* poses.c: of one finger and more. unfelt [5]: as UNFELT. */
fmfts_refusal fmfts_poses_of(const fmfts_several *model, const double *unfelt, const fmfts_fitted *fitted,
                             const fmfts_measured *measured, fmfts_several_work *work, fmfts_poses *poses);

/* As in free_poses.py. farthest: of each number of a magnet's change of pose. */
typedef struct fmfts_free_limits {
    double iterations, settled, rounding, damping, damping_factor, most_damping, half_a_press_m, farthest[FMFTS_POSE_CHANGE];
} fmfts_free_limits;

/* As FreePoses; the caller provides the arrays: [P], [P][P], [values], [3], [values][P], [P], [magnets][3],
 * [magnets][3]. */
typedef struct {
    double *change, *covariance, *misfit_t, *ambient_t, *by_pose, *counted, *position, *axis;
    double chi2;
} fmfts_free_poses;

/* free_poses.c: start [P]. */
fmfts_refusal fmfts_free_poses_of(const fmfts_several *model, const fmfts_free_limits *limits, const double *start,
                                  const fmfts_measured *measured, fmfts_several_work *work, fmfts_free_poses *found);

/* A finger that a fit found, of which `now` makes a linear field: noise_t, misfit_t [values], slope_t [values][3], ambient_t [3].
 * change_t: the measured change since rest, of rest_t. there [3]: where the finger is by now; NULL: where the fit found it. moment:
 * the factor on all moments. light_n: the errors of lighter fingers do not grow with the force. */
typedef struct {
    const double *finger, *change_t, *noise_t, *misfit_t, *slope_t, *ambient_t, *rest_t, *there;
    double moment, light_n;
} fmfts_ahead;

/* ahead.c: what each axis most likely reads at the finger, [values], and its derivative, [values][3]. */
void fmfts_look_ahead(const fmfts_several *model, const fmfts_ahead *from, fmfts_several_work *work, double *ahead_t,
                      double *by_finger);

/* A grid to scan. root [used][used]. room: FMFTS_SCAN_DOUBLES(values, padded places). */
typedef struct {
    const fmfts_search *search;
    const double *root;
    const fmfts_measured *measured;
    fmfts_several_work *work;
    double *room;
} fmfts_grid;

/* scan.c: fills the room with L⁻¹ · templates, [panels][used][FMFTS_PANEL]. Lists the values that there are in `work`. False where
 * one of them, or the root, is not finite. */
bool fmfts_white_templates(const fmfts_grid *grid);

/* Fingers that are known: predicted_t [values], slope [values][unknowns]. */
typedef struct {
    size_t unknowns;
    const double *predicted_t, *slope;
} fmfts_others;

/* another.c: found [2 + unknowns][places]: gain, force, and by_force of Scan.another, wherever the other fingers are. */
fmfts_refusal fmfts_another(const fmfts_grid *grid, const fmfts_others *others, double *found);

/* scan.c: finger [3] and what it gains. */
bool fmfts_best_single(const fmfts_grid *grid, double *finger, double *gain);

/* scan.c: starts [most][2][3]: the best pairs, at different places. count: how many there are. */
bool fmfts_best_pairs(const fmfts_grid *grid, size_t most, double *starts, size_t *count);

#endif
