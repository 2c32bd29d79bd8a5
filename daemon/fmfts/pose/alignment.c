/* From counts to the field at one instant, baseline subtracted: alignment.py and Estimator.read. */
#include <math.h>
#include <string.h>

#include "../sensor/reading.h"
#include "step.h"

enum { AMBIENT_VALUE = 7, AGE_UNKNOWN_US = 65535 };
static const double GAP_SHARE = 0.6, UNSEEN_SHARE = 0.2; /* see alignment.py */

static int little_endian(const uint8_t *bytes)
{
    return bytes[0] | bytes[1] << 8;
}

static int age_us(const fmfts_frame *frame, int sensor)
{
    return little_endian(frame->readings + FMFTS_READING_BYTES * sensor + 6);
}

static double sampled_us(const fmfts_frame *frame, int sensor)
{
    return frame->time_us - age_us(frame, sensor);
}

/* Forgets all samples if the board was reset, or if no frame came for long. */
static void forget_before_gap(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame)
{
    int sensors = (int)parameters->sensors[0];
    double newest = 0.0, before = 0.0;
    for (int i = 0; i < sensors; i++) {
        newest = fmax(newest, sampled_us(frame, i));
        before = fmax(before, memory->time_us[i]);
    }
    if (before == 0.0 || (newest >= before - parameters->stopped_us[0] && newest <= before + parameters->longest_gap_us[0])) {
        return;
    }
    for (int i = 0; i < 3 * sensors; i++) {
        memory->time_us[i] = 0.0;
    }
    for (int i = 0; i < 9 * sensors; i++) {
        memory->field_t[i] = NAN;
    }
}

/* Which samples are not in the memory: the fresh ones, and those that were fresh in a frame unseen here. */
static unsigned new_samples(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const fmfts_frame *frame)
{
    unsigned new = frame->fresh;
    double newest = -INFINITY, before = 0.0;
    for (int i = 0; i < (int)parameters->sensors[0]; i++) {
        newest = frame->fresh >> i & 1 ? fmax(newest, sampled_us(frame, i)) : newest;
        before = fmax(before, memory->time_us[i]);
    }
    for (int i = 0; newest - before > GAP_SHARE * parameters->stopped_us[0] && i < (int)parameters->sensors[0]; i++) {
        bool later = sampled_us(frame, i) - memory->time_us[i] > UNSEEN_SHARE * parameters->stopped_us[0];
        new |= (unsigned)(later && age_us(frame, i) < AGE_UNKNOWN_US) << i;
    }
    return new;
}

/* Puts the new samples into the memory. False if none is new, or if one is missing, saturated or stuck. */
static bool push(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame)
{
    int sensors = (int)parameters->sensors[0];
    unsigned all = (1u << sensors) - 1;
    if ((frame->valid & all) != all || frame->gain_code >= FMFTS_GAIN_CODES) {
        return false;
    }
    forget_before_gap(parameters, memory, frame);
    unsigned new = new_samples(parameters, memory, frame);
    if (!(new & all)) {
        return false;
    }
    for (int i = 0; i < sensors; i++) {
        double *sample[3], *time = memory->time_us + i;
        for (int k = 0; k < 3; k++) {
            sample[k] = memory->field_t + 3 * (k * sensors + i);
        }
        bool is_new = new >> i & 1;
        if (is_new) {
            memcpy(sample[2], sample[1], 3 * sizeof(double));
            memcpy(sample[1], sample[0], 3 * sizeof(double));
            time[2 * sensors] = time[sensors];
            time[sensors] = time[0];
            time[0] = sampled_us(frame, i);
        }
        for (int axis = 0; axis < 3; axis++) {
            int count = (int16_t)little_endian(frame->readings + FMFTS_READING_BYTES * i + 2 * axis);
            int saturated = (int)parameters->saturated_count[0], largest = (int)parameters->largest_count[0];
            if (count == saturated || count > largest || count < -largest - 1) {
                return false;
            }
            if (is_new) {
                double *repeats = memory->repeats + 3 * i + axis;
                sample[0][axis] = count * parameters->step_t[3 * frame->gain_code + axis];
                *repeats = sample[0][axis] == sample[1][axis] ? *repeats + 1.0 : 0.0;
            }
            /* Without three samples of an axis Python judges, unless C itself has just forgotten those before a gap. */
            if ((memory->passed[0] == 0.0 && !(isfinite(sample[2][axis]) && isfinite(sample[1][axis]))) ||
                !(memory->repeats[3 * i + axis] <= parameters->repeats_allowed[3 * i + axis])) {
                return false;
            }
        }
    }
    return true;
}

/* Interpolates one axis to the instant, subtracts the baseline, and computes the variance of what one sample adds. */
static void interpolate(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int axis, double instant,
                        fmfts_field *field)
{
    int sensors = (int)parameters->sensors[0], axes = 3 * sensors;
    const double *time = memory->time_us + axis / 3;
    double newest = memory->field_t[axis], previous = memory->field_t[axes + axis],
           oldest = memory->field_t[2 * axes + axis];
    double behind = time[0] - instant, gap = fmax(time[0] - time[sensors], 1.0),
           gap_before = fmax(time[sensors] - time[2 * sensors], 1.0);
    double share = fmin(fmax(behind / gap, 0.0), 1.0);
    bool linear = isfinite(previous) && time[sensors] > 0.0;
    double aligned = linear ? (1.0 - share) * newest + share * previous : newest;
    double slopes = (newest - previous) / gap - (previous - oldest) / gap_before;
    double bend = 2.0 * behind * fmax(gap - behind, 0.0) / (gap + gap_before) * slopes, jump = fabs(slopes) * gap;
    if (jump > parameters->jump_t[0] && share > 0.0) {
        bend = fmax(share, 1.0 - share) * jump;
    }
    if (!isfinite(bend)) { /* without a third sample the step itself bounds the error */
        double step = share * (newest - previous);
        bend = isfinite(step) ? step : 0.0;
    }
    double noise_square = parameters->noise_t[axis] * parameters->noise_t[axis] *
                          (share * share + (1.0 - share) * (1.0 - share));
    field->field_t[axis] = aligned / parameters->gain[axis] - parameters->offset_t[axis];
    field->lasting_t2[axis] = bend * bend;
    field->variance_t2[axis] = bend * bend + noise_square;
}

double fmfts_lasting_variance(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int axis,
                              const double change[3])
{
    const double *uniform = memory->state + AMBIENT_VALUE;
    const double *direction = parameters->direction + 3 * axis, *deviation = parameters->sensitivity_deviation + 3 * axis;
    double ambient = direction[0] * uniform[0] + direction[1] * uniform[1] + direction[2] * uniform[2];
    double by_place = parameters->place_deviation[axis / 3] * (change[axis % 3] - ambient), variance = 0.0;
    for (int k = 0; k < 3; k++) {
        variance += deviation[k] * change[k] * (deviation[k] * change[k]);
    }
    return variance + (by_place * by_place + parameters->systematic_t[0] * parameters->systematic_t[0]);
}

static void add_lasting(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int sensor, fmfts_field *field)
{
    double change[3];
    for (int k = 0; k < 3; k++) {
        change[k] = field->field_t[3 * sensor + k] - parameters->rest_field_t[3 * sensor + k];
    }
    for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
        field->unknown_t2[axis] = fmfts_lasting_variance(parameters, memory, axis, change);
        field->variance_t2[axis] += field->unknown_t2[axis];
    }
}

bool fmfts_align(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame, fmfts_field *field)
{
    int sensors = (int)parameters->sensors[0];
    if (!push(parameters, memory, frame)) {
        return false;
    }
    double latest = -INFINITY, instant = INFINITY;
    for (int i = 0; i < sensors; i++) {
        latest = fmax(latest, memory->time_us[i]);
        instant = fmin(instant, memory->time_us[i]);
    }
    if (!(latest - instant <= parameters->stopped_us[0])) {
        return false;
    }
    field->instant_us = instant;
    for (int axis = 0; axis < 3 * sensors; axis++) {
        interpolate(parameters, memory, axis, instant, field);
    }
    for (int i = 0; i < sensors; i++) {
        add_lasting(parameters, memory, i, field);
    }
    return true;
}

bool fmfts_has_jumped(const fmfts_pose_parameters *parameters, const fmfts_field *field)
{
    double most_t2 = parameters->jump_t[0] * parameters->jump_t[0] / 4.0;
    for (int axis = 0; axis < 3 * (int)parameters->sensors[0]; axis++) {
        if (field->lasting_t2[axis] > most_t2) {
            return true;
        }
    }
    return false;
}
