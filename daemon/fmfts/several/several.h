/* A pad with several magnets: the effect of fingers on its field, and its covariance. The Python file of the same name
 * as each C file has the equations.
 *
 * Re-entrant: no allocation, no globals. Units are those of the Python. Arrays are row-major and as long as the pad
 * needs; the sizes below are limits. */
#ifndef FMFTS_SEVERAL_H
#define FMFTS_SEVERAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../arithmetic/wide.h" /* FMFTS_LANES: rows of factors are padded to a multiple of it */
#include "../common/fields.h"
#include "../contact/press_table.h"

enum {
    FMFTS_SEVERAL_MAGNETS = FMFTS_MOST_TOGETHER,
    FMFTS_SEVERAL_SENSORS = 16,
    FMFTS_SEVERAL_FINGERS = 3,
    FMFTS_SEVERAL_CAUSES = 96,
    FMFTS_SEVERAL_TERMS = FMFTS_TABLE_TERMS,
    FMFTS_SEVERAL_PLACES = 31 * 31,
    FMFTS_SEVERAL_STARTS = 8,

    FMFTS_SEVERAL_VALUES = 3 * FMFTS_SEVERAL_SENSORS,
    FMFTS_SEVERAL_POSES = FMFTS_POSE_CHANGE * FMFTS_SEVERAL_MAGNETS,
    FMFTS_SEVERAL_UNKNOWNS = FMFTS_FINGER * FMFTS_SEVERAL_FINGERS,
    /* Causes that act through the poses: shear and patch of each finger, and the place of each magnet. */
    FMFTS_SEVERAL_MOVES = 3 * FMFTS_SEVERAL_FINGERS + 2 * FMFTS_SEVERAL_MAGNETS,
    /* Of the factor of C: ambient field, moment, the baseline's errors, these, and the table's error of each pose. */
    FMFTS_SEVERAL_COLUMNS = 3 + 1 + FMFTS_SEVERAL_CAUSES + FMFTS_SEVERAL_MOVES + FMFTS_SEVERAL_POSES,
};

/* The numbers at the head of a packed model; field_model.py reads their names. */
#define FMFTS_SEVERAL_HEAD(ONE, MANY)                                                                                  \
    ONE(double, magnets)                                                                                               \
    ONE(double, sensors)                                                                                               \
    ONE(double, causes) /* of the baseline's errors */                                                                 \
    ONE(double, width) /* of the table: X + 2 */                                                                       \
    ONE(double, terms) /* powers of the force */                                                                       \
    ONE(double, first_mm)                                                                                              \
    ONE(double, spacing_mm)                                                                                            \
    ONE(double, scale_n)                                                                                               \
    ONE(double, ambient_t) /* Scene */                                                                                 \
    ONE(double, moment)                                                                                                \
    ONE(double, friction)                                                                                              \
    ONE(double, patch_mm2) /* field_model.py */                                                                        \
    ONE(double, response_error)                                                                                        \
    ONE(double, sum_error_per_n)                                                                                       \
    MANY(double, unit, FMFTS_POSE_CHANGE) /* from the response's units to SI */

FMFTS_STRUCT(fmfts_several_head, FMFTS_SEVERAL_HEAD)

/* Views into one packed model, in the order in which field_model.py packs it. V: values, 3 for each sensor. P: numbers of
 * pose, 5 for each magnet. stride: V, padded. */
typedef struct {
    const fmfts_several_head *head;
    size_t magnets, sensors, causes, values, poses, stride;
    const double *position;   /* [magnets][3] at rest */
    const double *strength;   /* [magnets] */
    const double *octupole;   /* [magnets] */
    const double *frame;      /* [magnets][3][3] */
    const double *place;      /* [sensors][3] */
    const double *axes;       /* [sensors][3][3] */
    const double *at_rest;    /* [V] */
    const double *rest_slope; /* [V][P] */
    const double *by_ambient; /* [3][stride] */
    const double *off_mm;     /* [magnets][2] */
    const double *off_root;   /* [2·magnets][2·magnets] */
    const double *by_pose;    /* [P][causes][stride] */
    const double *by_field;   /* [3][causes][stride] */
    fmfts_press_table table;
} fmfts_several;

/* The field alone; with its slope by the fingers; with what shear and a wide patch do; with the baseline's errors there. */
typedef enum { FMFTS_NOTHING, FMFTS_FIELD_ALONE, FMFTS_SLOPED, FMFTS_ALL_OF_IT, FMFTS_WITH_LASTING } fmfts_known;

/* Predicted: field [V], slope [V][3·fingers], by_pose [V][P], change [P]; for each finger the array of press_table.h. of: the
 * fingers; known: how much of it is in the arrays. */
typedef struct {
    fmfts_known known;
    size_t fingers;
    double of[FMFTS_SEVERAL_UNKNOWNS];
    double field[FMFTS_SEVERAL_VALUES];
    double slope[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_UNKNOWNS];
    double by_pose[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_POSES];
    double change[FMFTS_SEVERAL_POSES];
    double pressed[FMFTS_SEVERAL_FINGERS][FMFTS_PRESSED * FMFTS_SEVERAL_POSES];
    double lasting[FMFTS_SEVERAL_CAUSES * FMFTS_SEVERAL_VALUES]; /* [causes][stride] */
} fmfts_predicted;

/* at [count][3]: x, y in mm, force in N. */
typedef struct {
    size_t count;
    const double *at;
} fmfts_fingers;

/* The covariance of a pad that nothing presses, but for noise: a parabola of the ambient field, of which these are the
 * coefficients. by_ambient: of x², y², z², xy, xz, yz. known: whether they are computed. */
typedef struct {
    bool known;
    double constant[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_VALUES];
    double by_ambient[6][FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_VALUES];
} fmfts_at_rest;

/* What the root in a work space is of; a frame's fit, valley and poses are of the same fingers. known: 0 where it is of
 * something else. */
typedef struct {
    size_t known, fingers, used, index[FMFTS_SEVERAL_VALUES];
    double of[FMFTS_SEVERAL_UNKNOWNS], ambient_t[3], variance_t2[FMFTS_SEVERAL_VALUES];
} fmfts_rooted;

/* What one Fitter computes in, for one model. */
typedef struct {
    fmfts_predicted predicted[2], aside; /* of a fit; of what else is asked meanwhile */
    double factor[FMFTS_SEVERAL_COLUMNS * FMFTS_SEVERAL_VALUES]; /* by columns: [columns][stride] */
    double by_pose[FMFTS_SEVERAL_POSES * FMFTS_SEVERAL_VALUES];  /* [P][stride], by the response's units */
    double covariance[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_VALUES];
    double root[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_VALUES];     /* [used][used] */
    double slope[FMFTS_SEVERAL_VALUES * FMFTS_SEVERAL_UNKNOWNS];  /* [used][3·fingers], white */
    double white[FMFTS_SEVERAL_VALUES];                           /* [used] */
    size_t used, index[FMFTS_SEVERAL_VALUES];                     /* the values that there are */
    fmfts_rooted rooted;
    fmfts_at_rest at_rest;
} fmfts_several_work;

/* packed.c: false if `packed` is no model, its table has no spacing, or it is too large. */
bool fmfts_view_several(const double *packed, size_t count, fmfts_several *model);

/* field_model.c: where the magnets are, [magnets][3], after a change of pose [P], in SI. */
void fmfts_moved_magnets(const fmfts_several *model, const double *change, double *position, double *axis);

/* field_model.c: by how much such a change changes the field [V], and its slope [V][P] there; NULL: not wanted. */
void fmfts_changed_field(const fmfts_several *model, const double *change, double *field, double *slope);

/* field_model.c: fills `predicted`, unless it already holds as much as is `wanted` of these fingers. */
void fmfts_predict(const fmfts_several *model, fmfts_fingers fingers, fmfts_known wanted, fmfts_predicted *predicted);

/* field_model.c: the number of the prediction in `work` that is of these fingers, which the last frame may have left; the first
 * is computed where none is. */
int fmfts_predict_in(const fmfts_several *model, fmfts_fingers fingers, fmfts_several_work *work);

/* covariance.c: what moves the poses besides the fingers' places and forces, each by one deviation, in the response's units:
 * [3·fingers + 2·magnets][P]. Returns how many. */
size_t fmfts_considered_moves(const fmfts_several *model, fmfts_fingers fingers, const fmfts_predicted *predicted, double *move);

/* covariance.c: deviation [P] of each number of pose, in the response's units: errors of the table, and of adding up
 * fingers. */
void fmfts_response_error(const fmfts_several *model, fmfts_fingers fingers, const fmfts_predicted *predicted, double *deviation);

/* covariance.c: fills work->covariance [V][V]. */
void fmfts_several_covariance(const fmfts_several *model, fmfts_fingers fingers, fmfts_predicted *predicted,
                              const double *variance_t2, const double ambient_t[3], fmfts_several_work *work);

#endif
