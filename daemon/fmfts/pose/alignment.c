/* From a frame's counts to the magnet's field at one instant, with the deviations of its errors. */
#include <math.h>
#include <string.h>

#include "model.h"
#include "push.h"
#include "step.h"

enum { AGE_UNKNOWN_US = 65535 }; /* frame.py: the time of a sample of this age or older is unknown */

static unsigned little_endian(const uint8_t *bytes)
{
    return bytes[0] | (unsigned)bytes[1] << 8;
}

static int count_of(const fmfts_frame *frame, int axis)
{
    return (int16_t)little_endian(frame->readings + FMFTS_READING_BYTES * (axis / 3) + 2 * (axis % 3));
}

static unsigned age_us(const fmfts_frame *frame, int sensor)
{
    return little_endian(frame->readings + FMFTS_READING_BYTES * sensor + 6);
}

fmfts_counted fmfts_judge_count(const fmfts_pose_parameters *parameters, int count)
{
    int largest = (int)parameters->largest_count;
    if (count == (int)parameters->saturated_count) {
        return FMFTS_SATURATED;
    }
    return count > largest || count < -largest - 1 ? FMFTS_NO_COUNT : FMFTS_A_FIELD;
}

double fmfts_field_of_count(const fmfts_pose_parameters *parameters, unsigned gain_code, int axis, int count)
{
    bool is_field = fmfts_judge_count(parameters, count) == FMFTS_A_FIELD;
    return is_field ? count * parameters->step_t[3 * gain_code + (unsigned)axis] : NAN;
}

/* The frame as push.c takes it. */
typedef struct {
    double field_t[FMFTS_AXES];
    int64_t time_us[FMFTS_SENSORS];
    uint8_t fresh[FMFTS_SENSORS], timed[FMFTS_SENSORS];
} samples;

static void read_samples(const fmfts_pose_parameters *parameters, const fmfts_frame *frame, fmfts_missing *missing, samples *taken)
{
    for (int i = 0; i < (int)parameters->sensors; i++) {
        bool valid = frame->valid >> i & 1;
        missing->silent[i] = !valid;
        missing->saturated[i] = missing->untellable[i] = missing->stuck[i] = 0;
        taken->time_us[i] = frame->time_us - age_us(frame, i);
        taken->fresh[i] = frame->fresh >> i & 1;
        taken->timed[i] = valid && age_us(frame, i) < AGE_UNKNOWN_US;
        for (int k = 0; k < 3; k++) {
            int axis = 3 * i + k, count = count_of(frame, axis);
            fmfts_counted is = fmfts_judge_count(parameters, count);
            missing->saturated[i] |= (unsigned char)((is == FMFTS_SATURATED) << k);
            missing->untellable[i] |= (unsigned char)((is == FMFTS_NO_COUNT) << k);
            taken->field_t[axis] = valid ? fmfts_field_of_count(parameters, frame->gain_code, k, count) : NAN;
        }
    }
}

static void remember_frame(fmfts_pose_memory *memory, const fmfts_frame *frame)
{
    if (frame->time_us != memory->frame_us) {
        memory->stood_ns = frame->host_ns;
        memory->stood_sequence = frame->sequence;
    }
    memory->sequence = frame->sequence;
    memory->frame_us = frame->time_us;
    memory->frame_ns = frame->host_ns;
}

/* Without a new sample the instant stays. After a jump of the board's clock it is converted to the new time. */
static int64_t instant_us(fmfts_pose_memory *memory, int64_t aligned_us, int64_t leap_us)
{
    if (!memory->without_news) {
        memory->leapt_us = 0;
        return aligned_us;
    }
    memory->leapt_us += leap_us;
    return (aligned_us ? aligned_us : memory->newest_us) + memory->leapt_us; /* 0 if all samples were forgotten */
}

static void note_stuck(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, fmfts_missing *missing)
{
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
        bool is_stuck = (double)memory->repeats[axis] > parameters->repeats_allowed[axis];
        missing->stuck[axis / 3] |= (unsigned char)(is_stuck << axis % 3);
    }
}

void fmfts_align(fmfts_step *step, const fmfts_frame *frame)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_pose_memory *memory = step->memory;
    fmfts_field *field = &step->field;
    size_t sensors = (size_t)parameters->sensors;
    const fmfts_periods periods = fmfts_periods_of(parameters->period_us);
    int64_t repeats[FMFTS_AXES];
    samples taken;
    read_samples(parameters, frame, &step->missing, &taken);
    step->missing.gain_code = frame->gain_code;
    const fmfts_last last = {memory->frame_us, memory->stood_ns, memory->stood_sequence};
    field->leap_us = fmfts_leap_us(&last, frame->time_us, frame->host_ns, frame->sequence, parameters->period_us);
    remember_frame(memory, frame);
    int64_t newest_us = fmfts_latest(sensors, memory->time_us);
    memory->newest_us = newest_us ? newest_us : memory->newest_us;
    fmfts_samples samples = {sensors, memory->field_t, memory->time_us, memory->repeats, memory->without_news};
    const fmfts_pushed pushed = {taken.field_t, taken.time_us, taken.fresh, taken.timed, true, frame->time_us};
    fmfts_aligned aligned = {
        .field_t = field->field_t, .noise_share = field->noise_share, .bend_t = field->bend_t, .repeats = repeats};
    fmfts_push(&periods, &samples, &pushed, &aligned);
    memory->without_news = samples.without_news;
    field->is_old = aligned.is_old;
    field->began_anew = aligned.began_anew;
    field->instant_us = instant_us(memory, aligned.time_us, field->leap_us);
    double passed_us = (double)field->instant_us - memory->last_us - (double)field->leap_us; /* NaN: there was none before */
    field->elapsed_s = passed_us > 0.0 ? passed_us * 1e-6 : 0.0;
    memory->last_us = (double)field->instant_us;
    note_stuck(parameters, memory, &step->missing);
}

double fmfts_lasting_variance(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int axis,
                              const double change[3])
{
    const double *uniform = memory->state + AMBIENT_VALUE;
    const double *direction = parameters->direction + 3 * axis, *deviation = parameters->sensitivity_deviation + 3 * axis;
    double ambient = direction[0] * uniform[0] + direction[1] * uniform[1] + direction[2] * uniform[2];
    /* An error of a sensor's place affects only the magnet's field. */
    double by_place = parameters->place_deviation[axis / 3] * (change[axis % 3] - ambient), variance = 0.0;
    for (int k = 0; k < 3; k++) {
        variance += deviation[k] * change[k] * (deviation[k] * change[k]);
    }
    return variance + (by_place * by_place + parameters->systematic_t * parameters->systematic_t);
}

static void note_warming(const fmfts_step *step)
{
    double warmed_k = step->temperature_c - step->parameters->rest_temperature_c;
    step->memory->warmed_k = isnan(warmed_k) ? step->memory->warmed_k : warmed_k;
}

/* The variances of one sensor's axes, whose field differs from that at rest. */
static void add_up(fmfts_step *step, int sensor, double drift_t2)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_field *field = &step->field;
    double change[3], share = field->noise_share[sensor], lasting_t2 = drift_t2 + FMFTS_ALTERNATING_SHARE * step->memory->alternating_t2;
    for (int k = 0; k < 3; k++) {
        change[k] = field->field_t[3 * sensor + k] - parameters->rest_field_t[3 * sensor + k];
        change[k] = isnan(change[k]) ? 0.0 : change[k]; /* an axis without a value does not judge the others */
    }
    for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
        double noise_t = parameters->noise_t[axis] * share;
        field->unknown_t2[axis] = fmfts_lasting_variance(parameters, step->memory, axis, change);
        field->other_t2[axis] = field->bend_t[axis] * field->bend_t[axis] + lasting_t2;
        field->variance_t2[axis] = field->unknown_t2[axis] + field->other_t2[axis] + noise_t * noise_t;
    }
}

void fmfts_subtract(fmfts_step *step)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    note_warming(step);
    double drifted_t2 = fmfts_drift_t2(step);
    for (int sensor = 0; sensor < (int)parameters->sensors; sensor++) {
        for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
            double *field_t = step->field.field_t + axis;
            bool is_stuck = step->missing.stuck[sensor] >> axis % 3 & 1;
            *field_t = is_stuck ? NAN : *field_t / parameters->gain[axis] - parameters->offset_t[axis];
        }
        add_up(step, sensor, drifted_t2);
    }
}

bool fmfts_has_jumped(const fmfts_step *step)
{
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        if (step->field.bend_t[axis] > FMFTS_JUMP_T / 2.0) {
            return true;
        }
    }
    return false;
}
