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

/* Whether a sensor's samples may be used: not if the frames that are judged here are those without it. */
static bool is_there(const fmfts_pose_memory *memory, int sensor)
{
    return !((unsigned)memory->silent[0] >> sensor & 1);
}

/* Forgets all samples if no frame came for long. False if the board was reset: Python knows what that ends. */
static bool forget_before_gap(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame)
{
    int sensors = (int)parameters->sensors[0];
    double newest = 0.0, before = 0.0;
    for (int i = 0; i < sensors; i++) {
        newest = is_there(memory, i) ? fmax(newest, sampled_us(frame, i)) : newest;
        before = fmax(before, memory->time_us[i]);
    }
    if (before != 0.0 && newest < before - parameters->stopped_us[0]) {
        return false;
    }
    if (before == 0.0 || newest <= before + parameters->longest_gap_us[0]) {
        return true;
    }
    for (int i = 0; i < 3 * sensors; i++) {
        memory->time_us[i] = 0.0;
    }
    for (int i = 0; i < 9 * sensors; i++) {
        memory->field_t[i] = NAN;
    }
    return true;
}

/* Which samples are not in the memory: the fresh ones, and those that were fresh in a frame unseen here; of the sensors that
 * are there. */
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
        new |= (unsigned)(later && is_there(memory, i) && age_us(frame, i) < AGE_UNKNOWN_US) << i;
    }
    return new;
}

/* Puts one axis' count into the memory. False if it is stuck, if it cannot be, or if it is saturated and was not before. */
static bool push_axis(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame, int axis,
                      bool is_new)
{
    int sensors = (int)parameters->sensors[0], axes = 3 * sensors;
    int count = (int16_t)little_endian(frame->readings + FMFTS_READING_BYTES * (axis / 3) + 2 * (axis % 3));
    int saturated = (int)parameters->saturated_count[0], largest = (int)parameters->largest_count[0];
    double *sample = memory->field_t + axis, *repeats = memory->repeats + axis;
    bool is_saturated = count == saturated;
    if (is_saturated != (memory->saturated[axis] != 0.0) || (!is_saturated && (count > largest || count < -largest - 1))) {
        return false;
    }
    if (is_new) {
        *sample = is_saturated ? NAN : count * parameters->step_t[3 * frame->gain_code + axis % 3];
        *repeats = *sample == sample[axes] ? *repeats + 1.0 : 0.0;
    }
    /* Without three samples of an axis Python judges, unless C itself has just forgotten those before a gap. */
    bool is_known = memory->passed[0] != 0.0 || (isfinite(sample[2 * axes]) && isfinite(sample[axes]));
    return is_saturated || (is_known && *repeats <= parameters->repeats_allowed[axis]);
}

/* Puts the new samples into the memory. False if none is new, if one is stuck, or if others are missing than in the frames
 * before. */
static bool push(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame)
{
    int sensors = (int)parameters->sensors[0];
    unsigned all = (1u << sensors) - 1, there = all & ~(unsigned)memory->silent[0];
    /* What is said of a saturated axis depends on the range. */
    bool is_as_before = (frame->valid & all) == there && !(frame->fresh & all & ~there) &&
                        (memory->gain_code[0] < 0.0 || frame->gain_code == memory->gain_code[0]);
    if (!is_as_before || frame->gain_code >= FMFTS_GAIN_CODES || !forget_before_gap(parameters, memory, frame)) {
        return false;
    }
    unsigned new = new_samples(parameters, memory, frame);
    if (!(new & all)) {
        return false;
    }
    for (int i = 0; i < sensors; i++) {
        double *sample = memory->field_t + 3 * i, *time = memory->time_us + i;
        int axes = 3 * sensors;
        bool is_new = new >> i & 1;
        if (is_new) {
            memcpy(sample + 2 * axes, sample + axes, 3 * sizeof(double));
            memcpy(sample + axes, sample, 3 * sizeof(double));
            time[2 * sensors] = time[sensors];
            time[sensors] = time[0];
            time[0] = sampled_us(frame, i);
        }
        for (int axis = 3 * i; is_there(memory, i) && axis < 3 * i + 3; axis++) {
            if (!push_axis(parameters, memory, frame, axis, is_new)) {
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
        change[k] = isnan(change[k]) ? 0.0 : change[k]; /* what was not measured says nothing of the other axes */
    }
    for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
        field->unknown_t2[axis] = fmfts_lasting_variance(parameters, memory, axis, change);
        field->variance_t2[axis] += field->unknown_t2[axis] + field->other_t2[axis];
    }
}

bool fmfts_align(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame, fmfts_field *field)
{
    int sensors = (int)parameters->sensors[0];
    if (!(memory->passed[0] < memory->most[0]) || !push(parameters, memory, frame)) {
        return false;
    }
    double latest = -INFINITY, instant = INFINITY;
    for (int i = 0; i < sensors; i++) {
        latest = fmax(latest, memory->time_us[i]);
        instant = is_there(memory, i) ? fmin(instant, memory->time_us[i]) : instant;
    }
    if (!(latest - instant <= parameters->stopped_us[0])) {
        return false;
    }
    field->instant_us = instant;
    double warmed_k = frame->temperature_c - parameters->rest_temperature_c[0];
    memory->warmed_k[0] = isnan(warmed_k) ? memory->warmed_k[0] : warmed_k;
    double drift_t = parameters->offset_t_per_k[0] * memory->warmed_k[0];
    for (int axis = 0; axis < 3 * sensors; axis++) {
        field->other_t2[axis] = drift_t * drift_t;
        if (is_there(memory, axis / 3)) {
            interpolate(parameters, memory, axis, instant, field);
        } else {
            field->field_t[axis] = NAN;
            field->lasting_t2[axis] = field->variance_t2[axis] = 0.0;
        }
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
