/* The uncertainty of a contact from the pad's structure. Silicone differs from cast to cast, and the finger is unknown.
 * These errors are the same in every frame of a pad or touch, so no filter reduces them. Each cause shifts the answer
 * by e, and adds e e^T:
 *
 * - A modulus that is m times as high takes m times the force for the same movement, at the same place.
 * - Thicker silicone moves less, and in another shape. Its effect on an answer depends on the distance of the press
 * from the middle: parameters.
 * - Both multiply a force, and the logarithm of their product is normal. So a force is wrong by more upwards than downwards: with s the
 *   deviation of the logarithm, e = (e^s - 1) F is the deviation upwards. The root of the mean square, and more so a sum of both
 *   causes' squares, is less: it left nearly twice as many pads beyond five deviations.
 * - A finger of another size or shape moves the magnet like the mean of presses at the points of its area, to second order:
 *   d = (h(x + a) + h(x - a)) / 2 - h(x), where a^2 is what its second moment has more than the probe's that calibrated the pad. The
 *   model's Jacobian J takes d for a movement: e = J d. Where the finger's width is known, d is taken from the movement instead. */
#include <math.h>
#include <string.h>

#include "../arithmetic/elementary.h"
#include "step.h"

enum { CONTACT = FMFTS_CONTACT, POSE = FMFTS_POSE, MOVED = FMFTS_MOVED, FORCE = 2 };

/* Difference of a finger's moments along and across, as a share of their common difference from the probe's. */
#define UNEVEN 0.5
/* The widest finger, in deviations. Its error is that at its true place, which near the middle is farther out than the
 * answer. Models without shear use the error at the answer. */
#define WIDEST 2.0
/* Smallest component of the axis along z: that of a magnet that lies flat is 0, and its tilt changes nothing along
 * z. */
#define LEAST_UPRIGHT 1e-3

/* A disc of 12 mm is the probe of 6 mm, smeared over a ring, whose fourth moments are then right to an eighth. */
#define HALF_ROOT 0.70710678118654752
enum { ON_RING = 8 };
static const double RING[ON_RING][2] = {{1.0, 0.0},  {HALF_ROOT, HALF_ROOT},   {0.0, 1.0},  {-HALF_ROOT, HALF_ROOT},
                                        {-1.0, 0.0}, {-HALF_ROOT, -HALF_ROOT}, {0.0, -1.0}, {HALF_ROOT, -HALF_ROOT}};

static void add_square(double *variance, double error)
{
    *variance += error * error;
}

/* Interpolates linearly; beyond the last ring, its value holds. */
static double at_radius(const fmfts_contact_parameters *parameters, const double table[FMFTS_RINGS], double radius_mm)
{
    double ring = fmin(radius_mm / parameters->ring_mm, FMFTS_RINGS - 1.0);
    int inner = ring < FMFTS_RINGS - 1.0 ? (int)ring : FMFTS_RINGS - 2;
    return table[inner] + (ring - inner) * (table[inner + 1] - table[inner]);
}

static void count_silicone(const fmfts_contact_parameters *parameters, const fmfts_answer *answer, double *variance)
{
    const double *contact = answer->contact;
    double radius_mm = sqrt(contact[0] * contact[0] + contact[1] * contact[1]);
    double modulus = parameters->modulus, thicker = at_radius(parameters, parameters->thicker_share, radius_mm);
    double upwards = fmfts_exp(sqrt(modulus * modulus + thicker * thicker)) - 1.0;
    double outwards_mm = at_radius(parameters, parameters->thicker_mm, radius_mm);
    for (int axis = 0; axis < FORCE && radius_mm > 0.0; axis++) {
        add_square(&variance[axis], outwards_mm * contact[axis] / radius_mm);
    }
    for (int load = FORCE; load < answer->outputs; load++) {
        add_square(&variance[load], upwards * contact[load]);
    }
}

void fmfts_wider_finger(const fmfts_response *response, const double press[CONTACT], double wider_mm2, double more[2][MOVED])
{
    double middle[MOVED], away_mm = sqrt(fabs(wider_mm2)), sign = wider_mm2 < 0.0 ? -1.0 : 1.0;
    fmfts_move(response, press, middle);
    for (int axis = 0; axis < 2; axis++) {
        double aside[CONTACT], before[MOVED], after[MOVED];
        memcpy(aside, press, sizeof aside);
        aside[axis] = press[axis] - away_mm;
        fmfts_move(response, aside, before);
        aside[axis] = press[axis] + away_mm;
        fmfts_move(response, aside, after);
        for (int i = 0; i < MOVED; i++) {
            more[axis][i] = sign * ((before[i] + after[i]) / 2.0 - middle[i]);
        }
    }
}

void fmfts_wider_disc(const fmfts_response *response, const double press[CONTACT], double wider_mm2, double more[MOVED])
{
    double middle[MOVED], radius_mm = sqrt(2.0 * fabs(wider_mm2)), share = (wider_mm2 < 0.0 ? -1.0 : 1.0) / ON_RING;
    fmfts_move(response, press, middle);
    for (int i = 0; i < MOVED; i++) {
        more[i] = 0.0;
    }
    for (int point = 0; point < ON_RING; point++) {
        double aside[CONTACT], moved[MOVED];
        memcpy(aside, press, sizeof aside);
        aside[0] += radius_mm * RING[point][0];
        aside[1] += radius_mm * RING[point][1];
        fmfts_move(response, aside, moved);
        for (int i = 0; i < MOVED; i++) {
            more[i] += share * (moved[i] - middle[i]);
        }
    }
}

void fmfts_take_known_finger(const fmfts_contact_parameters *parameters, const fmfts_response *response,
                             const double press[CONTACT], double pose[POSE])
{
    double more[MOVED];
    fmfts_wider_disc(response, press, parameters->known_finger_mm2, more);
    for (int i = 0; i < MOVED; i++) {
        pose[i] -= more[i];
    }
    pose[5] = sqrt(fmax(1.0 - pose[3] * pose[3] - pose[4] * pose[4], 0.0));
}

/* error: of each output for this additional movement of the magnet. The axis stays a unit vector. */
static void error_of(const fmfts_question *question, const fmfts_answer *answer, const double moved[MOVED], double error[CONTACT])
{
    double along = question->pose[3] * moved[3] + question->pose[4] * moved[4], upright = question->pose[5];
    if (fabs(upright) < LEAST_UPRIGHT) {
        upright = copysign(LEAST_UPRIGHT, upright);
    }
    for (int i = 0; i < answer->outputs; i++) {
        const double *row = answer->by_pose + POSE * i;
        error[i] = -row[5] * along / upright;
        for (int k = 0; k < MOVED; k++) {
            error[i] += row[k] * moved[k];
        }
    }
}

/* The error of each output for a finger that is wider by one deviation, and for one that is wider along x than along y. */
typedef struct {
    double common[CONTACT], uneven[CONTACT];
} finger_errors;

/* Of a press there. */
static finger_errors errors_at(const fmfts_contact_parameters *parameters, const fmfts_response *response,
                               const fmfts_question *question, const fmfts_answer *answer, const double press[CONTACT])
{
    double along[2][MOVED], both[MOVED], differing[MOVED];
    finger_errors errors;
    fmfts_wider_finger(response, press, parameters->finger_mm2, along);
    for (int i = 0; i < MOVED; i++) {
        both[i] = along[0][i] + along[1][i];
        differing[i] = UNEVEN * (along[0][i] - along[1][i]);
    }
    error_of(question, answer, both, errors.common);
    error_of(question, answer, differing, errors.uneven);
    return errors;
}

static void count_finger(const fmfts_contact_parameters *parameters, const fmfts_response *response,
                         const fmfts_question *question, const fmfts_answer *answer, double *variance)
{
    double press[CONTACT] = {0.0};
    memcpy(press, answer->contact, sizeof(double) * (size_t)answer->outputs);
    const finger_errors here = errors_at(parameters, response, question, answer, press);
    finger_errors widest = here;
    if (parameters->shear_share > 0.0) {
        for (int i = 0; i < answer->outputs; i++) {
            press[i] -= WIDEST * here.common[i];
        }
        press[FORCE] = fmax(press[FORCE], 0.0);
        widest = errors_at(parameters, response, question, answer, press);
    }
    for (int i = 0; i < answer->outputs; i++) {
        add_square(&variance[i], fmax(fabs(here.common[i]), fabs(widest.common[i])));
        add_square(&variance[i], here.uneven[i]);
    }
}

void fmfts_count_tolerances(const fmfts_contact_parameters *parameters, const fmfts_response *response,
                           const fmfts_question *question, const fmfts_answer *answer, double variance[CONTACT])
{
    for (int i = 0; i < CONTACT; i++) {
        variance[i] = 0.0;
    }
    if (!(answer->contact[FORCE] > 0.0)) {
        return; /* nothing presses */
    }
    count_silicone(parameters, answer, variance);
    if (response && parameters->finger_mm2 > 0.0) {
        count_finger(parameters, response, question, answer, variance);
    }
}
