/* Watches the mean residuals of many frames, and can overrule the verdict on a single frame. */
#include <string.h>

#include "mean_residuals.h"

static bool ambient_is_known(const fmfts_pose_parameters *parameters)
{
    return parameters->part[AMBIENT_COLUMN] == FMFTS_FIXED;
}

/* Whether a mask names one sensor. */
static bool is_one(int64_t sensors)
{
    return sensors != 0 && (sensors & (sensors - 1)) == 0;
}

static int first_of(int64_t sensors)
{
    int sensor = 0;
    while (!(sensors >> sensor & 1)) {
        sensor++;
    }
    return sensor;
}

int fmfts_blamed(const fmfts_pose_memory *memory)
{
    return memory->found && memory->found_sensor >= 0 ? (int)memory->found_sensor : -1;
}

/* In a drifting scene at rest, no unknown explains only four of twelve values. In these, faults of the same axis of opposite
 * sensors look alike, and so do those of all z axes: a frame tells them apart only by the last ambient field. That works at the
 * start of a fault, but not after the ambient field was estimated from the faulty sensor. */
bool fmfts_confirms(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, int sensor)
{
    if (ambient_is_known(parameters) || memory->sound) {
        memory->heard |= (int64_t)1 << sensor;
    }
    return memory->heard >> sensor & 1;
}

static void say_suspects(const fmfts_step *step, fmfts_text *reason)
{
    const char *before = "sensor ";
    for (int sensor = 0; sensor < (int)step->parameters->sensors; sensor++) {
        if (step->memory->suspects >> sensor & 1) {
            fmfts_say(reason, "%s%d", before, sensor + 1);
            before = " or ";
        }
    }
    if (is_one(step->memory->suspects)) { /* no other sensor explains it as well, so the cause is no sensor */
        fmfts_say(reason, " is a little off, or a weak foreign field is near: it is not clear which");
    } else {
        fmfts_say(reason, " is a little off: it is not clear which one");
    }
}

/* The hint that the chips' warming may explain the mean. */
static void say_warming(const fmfts_step *step, fmfts_text *reason)
{
    double warmed_k = fabs(step->temperature_c - step->parameters->rest_temperature_c); /* NaN: not known */
    if (warmed_k > FMFTS_WARMED_K) {
        fmfts_say(reason,
                  "; or offsets of chips drifted, as the pad is over %g K from its baseline's temperature: record --rest again",
                  warmed_k - fmod(warmed_k, FMFTS_WARMED_K));
    }
}

/* Replaces the verdict on a frame that fits by the verdict of the frames before it. */
static void overrule(fmfts_step *step)
{
    const fmfts_pose_memory *memory = step->memory;
    fmfts_verdict *verdict = &step->verdict;
    fmfts_text *reason = &verdict->reason;
    bool is_degraded = verdict->health == FMFTS_DEGRADED, single_frames_agree = is_one(memory->heard);
    if (!memory->found || (verdict->health != FMFTS_OK && !is_degraded)) {
        return;
    }
    if (fmfts_blamed(memory) >= 0) {
        verdict->health = FMFTS_DEGRADED;
        fmfts_clear(reason);
        fmfts_say(reason, "sensor %d still contradicts the others: it is left out", fmfts_blamed(memory) + 1);
        return;
    }
    if (!memory->found_foreign && single_frames_agree && is_degraded) {
        return;
    }
    fmfts_clear(reason);
    verdict->has_estimate = false;
    if (memory->found_foreign) {
        /* If the scene holds the ambient field fixed, a turned robot appears as a uniform foreign field. */
        verdict->health = FMFTS_DISTURBED;
        fmfts_say(reason, "a weak foreign field: steel or another magnet is near%s",
                  ambient_is_known(step->parameters) ? ", or the robot has turned" : "");
    } else {
        verdict->health = FMFTS_LOST;
        say_suspects(step, reason);
    }
    say_warming(step, reason);
}

/* residual_t [axes]: measured, also by an excluded sensor, minus predicted by `nearest`. */
static void find_residuals(fmfts_step *step, double *residual_t)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    const double magnet[FMFTS_MAGNET] = {parameters->strength_t_m3, parameters->octupole_m2}, *state = step->nearest.state;
    fmfts_sources sources = {.count = 1, .log_moment = {NAN}, .with_gradient = true};
    fmfts_sight sight[FMFTS_MAX_MAGNETS];
    place_sources(magnet, state, &sources);
    memcpy(residual_t, step->field.field_t, sizeof step->field.field_t);
    fmfts_take_neighbours(step, step->nearest.placed, residual_t);
    for (int i = 0; i < (int)parameters->sensors; i++) {
        const double *place = parameters->place_m + 3 * i;
        look_all(&sources, place, sight);
        for (int axis = 3 * i; axis < 3 * i + 3; axis++) {
            const double *direction = parameters->direction + 3 * axis;
            residual_t[axis] -= sense_all(&sources, sight, state, place, direction, step->slopes[axis]);
        }
    }
}

/* Adds the frame's residuals to the mean, and judges the mean from time to time. */
static void observe(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    if (!step->nearest.known) {
        fmfts_forget_means(memory);
        return;
    }
    find_residuals(step, step->residual_t);
    if (!fmfts_push_means(step, step->residual_t)) {
        return;
    }
    fmfts_finding found = fmfts_judge_means(step);
    if (memory->sound) {
        memory->heard = 0;
    } else if (found.is_wrong && found.sensor < 0 && is_one(memory->heard) && (memory->heard & found.suspects)) {
        found.sensor = first_of(memory->heard); /* the mean residual suspects this sensor, too */
    }
    memory->found = found.is_wrong;
    memory->found_sensor = found.sensor;
    memory->found_foreign = found.foreign;
    memory->suspects = found.suspects;
}

void fmfts_watch_residuals(fmfts_step *step)
{
    if (step->parameters->at_rest == 0.0) {
        return; /* errors of healthy sensors are not known */
    }
    overrule(step);
    observe(step);
}
