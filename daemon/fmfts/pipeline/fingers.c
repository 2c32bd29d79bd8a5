/* From what several fingers, or the poses of several magnets, are estimated to be, to the fields of their message. */
#include "fingers.h"

#include <math.h>
#include <string.h>

#include "../several/resultant.h"

enum { NUMBERS = FMFTS_FINGER_NUMBERS, FORCE = 2, SHEAR = 3, CHANGE = 5, REST = 6 };

static const double UNIT[NUMBERS] = {1e-3, 1e-3, 1.0}; /* mm → m; newtons stay */

/* share: deviation of the force from creep and from the cast. Shear is null if none is expected (friction 0), because it is not
 * certain to be zero. */
static void tell_finger(double share, const double *number, const double *deviation, const double *shear_n,
                        const double *shear_deviation_n, fmfts_told_finger *told)
{
    for (int i = 0; i < NUMBERS; i++) {
        told->value[i] = UNIT[i] * number[i];
        told->deviation[i] = UNIT[i] * deviation[i];
    }
    double of_share = share * number[FORCE];
    told->deviation[FORCE] = sqrt(deviation[FORCE] * deviation[FORCE] + of_share * of_share);
    told->value[FORCE] = fmax(number[FORCE], 0.0);
    told->outputs = shear_deviation_n[0] > 0.0 && shear_deviation_n[1] > 0.0 ? FMFTS_CONTACT : NUMBERS;
    memcpy(told->value + SHEAR, shear_n, 2 * sizeof(double));
    memcpy(told->deviation + SHEAR, shear_deviation_n, 2 * sizeof(double));
}

/* The resultant. The sum of shears has an upper bound of its deviation: the correlation of two fingers' errors is not kept. */
static void tell_resultant(const fmfts_mounted_parameters *mounted, const fmfts_frame_found *found, const double *deviation,
                           fmfts_reading *reading)
{
    double whole[NUMBERS], shear_n[2] = {0.0}, shear_deviation_n[2] = {0.0};
    fmfts_told_finger told;
    fmfts_resultant((size_t)found->count, found->fingers, whole);
    for (size_t i = 0; i < 2 * (size_t)found->count; i++) {
        shear_n[i % 2] += found->shear_n[i];
        shear_deviation_n[i % 2] += found->shear_deviation_n[i];
    }
    tell_finger(mounted->silicone_share, whole, deviation, shear_n, shear_deviation_n, &told);
    reading->tells_place = true;
    reading->estimate.outputs = told.outputs;
    memcpy(reading->estimate.place, told.value, sizeof told.value);
    memcpy(reading->estimate.deviation, told.deviation, sizeof told.deviation);
    reading->force_n = told.value[FORCE];
    reading->force_sd_n = told.deviation[FORCE];
}

/* The contact, and each finger. */
static void tell_fingers(const fmfts_mounted_parameters *mounted, const fmfts_frame_found *found, fmfts_told_several *several,
                         fmfts_reading *reading)
{
    const size_t count = (size_t)found->count;
    const double *least = found->has_least ? found->least : NULL;
    double deviation[NUMBERS * (1 + FMFTS_TOLD_FINGERS)];
    reading->contact = count ? FMFTS_IN_CONTACT : FMFTS_NO_CONTACT;
    reading->over_range = reading->tells_force_min = found->over_range;
    reading->force_min_n = 0.0;
    for (size_t f = 0; f < count; f++) {
        reading->force_min_n += fmin(found->fingers[NUMBERS * f + FORCE], mounted->scale_n);
    }
    if (reading->over_range) {
        return; /* beyond the table there is only this lower bound */
    }
    several->tells_fingers = reading->tells_force = true;
    several->fingers = count;
    reading->force_n = 0.0;
    reading->force_sd_n = mounted->quiet_force_sd_n;
    if (!count) {
        return;
    }
    fmfts_finger_deviations(count, found->fingers, found->covariance, least, deviation);
    for (size_t f = 0; f < count; f++) {
        tell_finger(mounted->silicone_share, found->fingers + NUMBERS * f, deviation + NUMBERS * (1 + f), found->shear_n + 2 * f,
                    found->shear_deviation_n + 2 * f, &several->finger[f]);
        several->finger[f].id = found->id[f];
    }
    tell_resultant(mounted, found, deviation, reading);
}

/* Root mean square of the values that were used. */
static double residual_of(const fmfts_frame_found *found, size_t axes)
{
    double sum = 0.0, count = 0.0;
    for (size_t i = 0; i < axes; i++) {
        sum += found->used[i] ? found->misfit_t[i] * found->misfit_t[i] : 0.0;
        count += found->used[i] ? 1.0 : 0.0;
    }
    return sqrt(sum / count);
}

/* ambient_t: its change since the baseline on an untouched pad, whose deviation the baseline's errors widen. */
static void tell_ambient(const fmfts_mounted_parameters *mounted, const double *ambient_t, fmfts_reading *reading)
{
    const double *error = mounted->ambient_error;
    for (int i = 0; i < 3; i++) {
        double variance = mounted->ambient_noise_t2[i] + mounted->ambient_deviation_t[i] * mounted->ambient_deviation_t[i];
        for (int cause = 0; cause < (int)mounted->causes; cause++, error += 3) {
            double own = error[0] * ambient_t[0] + error[1] * ambient_t[1] + error[2] * ambient_t[2];
            variance += own * own;
        }
        reading->ambient_t[i] = mounted->ambient_t[i] + ambient_t[i];
        reading->ambient_sd_t[i] = sqrt(variance);
    }
}

/* The poses of all magnets. Under a finger the deviation of the ambient field is larger than that of its mean, but is not kept. */
static void tell_magnets(const fmfts_mounted_parameters *mounted, const fmfts_frame_found *found, size_t axes,
                         fmfts_told_several *several, fmfts_reading *reading)
{
    several->tells_poses = true;
    several->magnets = (size_t)mounted->magnets;
    for (size_t m = 0; m < several->magnets; m++) {
        fmfts_told_pose *pose = &several->pose[m];
        double deviation[CHANGE];
        for (int i = 0; i < CHANGE; i++) {
            deviation[i] = sqrt(found->variance[CHANGE * m + i] + mounted->rest_variance[REST * m + i]);
        }
        memcpy(pose->position_m, found->position + 3 * m, 3 * sizeof(double));
        memcpy(pose->position_sd_m, deviation, 3 * sizeof(double));
        memcpy(pose->axis, found->axis + 3 * m, 3 * sizeof(double));
        pose->axis_sd_rad = fmax(deviation[3], deviation[4]);
        pose->remanence_t = mounted->remanence_t[m];
        pose->remanence_sd_t = mounted->remanence_deviation_t[m];
    }
    reading->residual_t = residual_of(found, axes);
    reading->chi2 = found->chi2;
    reading->ambient_t[0] = NAN;
    if (reading->contact != FMFTS_IN_CONTACT && !isnan(mounted->ambient_t[0])) {
        tell_ambient(mounted, found->ambient_t, reading);
    }
}

void fmfts_tell_found(const fmfts_mounted_parameters *mounted, const fmfts_frame_found *found, size_t sensors,
                      fmfts_told_several *several, fmfts_reading *reading)
{
    const uint8_t *used = found->used;
    memset(several, 0, sizeof *several);
    several->more = found->more;
    reading->several = several;
    reading->contact = found->contact < 0 ? FMFTS_NOT_KNOWN : found->contact ? FMFTS_IN_CONTACT : FMFTS_NO_CONTACT;
    reading->over_range = reading->tells_force = reading->tells_place = reading->tells_force_min = false;
    reading->tells_pose = reading->tells_slip = false;
    reading->tells_displacement = !isnan(found->displacement_m);
    reading->displacement_m = found->displacement_m;
    reading->displacement_sd_m = found->displacement_sd_m;
    reading->sensors_ok = 0;
    for (size_t i = 0; i < sensors; i++, used += 3) {
        reading->sensors_ok |= (unsigned)(used[0] && used[1] && used[2]) << i;
    }
    if (found->has_fingers) {
        tell_fingers(mounted, found, several, reading);
    }
    if (found->has_magnets) {
        tell_magnets(mounted, found, 3 * sensors, several, reading);
    }
}
