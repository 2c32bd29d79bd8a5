/* The fields of a frame's message, from the results of its steps. */
#include <math.h>
#include <string.h>

#include "../arithmetic/elementary.h"
#include "../pose/model.h"
#include "steps.h"

void fmfts_begin_step(const fmfts_parameters *parameters, fmfts_memory *memory, double temperature_c, fmfts_frame_work *work)
{
    fmfts_step *step = &work->step;
    work->memory = memory;
    work->touch_is_known = work->has_estimate = false;
    work->lifted_m = 0.0;
    step->parameters = &parameters->pose;
    step->memory = &memory->pose;
    step->errors.causes = 0;
    step->temperature_c = temperature_c;
    step->felt.count = 0;
    step->posture = FMFTS_POSTURE_NONE;
    step->nearest.known = false;
    step->verdict.health = FMFTS_OK;
    step->verdict.has_estimate = step->verdict.stronger = false;
    fmfts_clear(&step->verdict.reason);
}

void fmfts_begin(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_frame *frame, fmfts_frame_work *work,
                 fmfts_reading *reading)
{
    fmfts_begin_step(pad->parameters, memory, frame->temperature_c, work);
    work->step.errors = pad->errors;
    work->step.missing.words = &pad->words.chip;
    reading->now.known = reading->judged.known = reading->slip.known = false;
    reading->tells_slip = pad->parameters->slip.tells_slip != 0.0;
    reading->several = NULL;
}

/* When the instant was on the host's clock. In a recording's memory it may be any time. */
static int64_t host_ns_at(const fmfts_frame *frame, int64_t instant_us)
{
    const double most_ns = 2305843009213693952.0; /* 2^61, as the host's own times */
    double ago_ns = 1000.0 * (double)(frame->time_us - instant_us);
    return frame->host_ns - (int64_t)fmin(fmax(ago_ns, -most_ns), most_ns);
}

void fmfts_date(const fmfts_frame *frame, fmfts_frame_work *work)
{
    const fmfts_field *field = &work->step.field;
    if (frame->valid && !field->is_old) {
        work->memory->message.sampled_ns = host_ns_at(frame, field->instant_us);
    }
    if (field->began_anew) {
        fmfts_forget_touch(&work->memory->contact); /* the length of the gap is unknown: the finger may be gone */
    }
    if (field->leap_us) {
        fmfts_forget_motion(&work->memory->motion);
    }
}

void fmfts_degrade(fmfts_verdict *verdict, const char *why)
{
    fmfts_say(&verdict->reason, verdict->reason.size ? "; %s" : "%s", why);
    verdict->health = FMFTS_DEGRADED;
}

/* The absolute pose. Its variance is that of the change from rest plus that of the rest pose. */
static void read_pose(const fmfts_message_parameters *parameters, const fmfts_step *step, fmfts_reading *reading)
{
    const double *state = step->memory->state, *own = step->pose.covariance;
    double deviation[6];
    for (int i = 0; i < 6; i++) {
        deviation[i] = sqrt(own[(FMFTS_STEP + 1) * i] + parameters->rest_variance[i]);
    }
    for (int i = 0; i < 3; i++) {
        reading->pose.position_m[i] = state[i];
        reading->pose.position_sd_m[i] = deviation[i];
        reading->pose.axis[i] = state[AXIS_VALUE + i];
        reading->ambient_t[i] = parameters->ambient_t[i] + state[AMBIENT_VALUE + i];
        reading->ambient_sd_t[i] = sqrt(parameters->ambient_variance[i] + own[(FMFTS_STEP + 1) * (AMBIENT_COLUMN + i)]);
    }
    reading->pose.axis_sd_rad = fmax(deviation[3], deviation[4]);
    reading->pose.remanence_t = parameters->remanence_t * fmfts_exp(state[LOG_VALUE]);
    reading->pose.remanence_sd_t = deviation[5] * reading->pose.remanence_t;
    reading->residual_t = step->pose.residual_t;
    reading->chi2 = step->pose.chi2;
}

/* Without a contact the force is 0, without a place. Beyond the model's range there is only a lower bound. A shear
 * model gives no values where it cannot separate shear from place. */
static void read_contact(const fmfts_pad *pad, const fmfts_frame_work *work, fmfts_reading *reading)
{
    const fmfts_estimate *estimate = &work->estimate;
    bool touching = fmfts_is_published(&work->memory->contact);
    reading->estimate = *estimate;
    reading->contact = touching ? FMFTS_IN_CONTACT : FMFTS_NO_CONTACT;
    reading->over_range = reading->tells_force_min = touching && estimate->over_range;
    reading->tells_place = touching && !estimate->over_range && !estimate->refused;
    reading->tells_force = !touching || reading->tells_place;
    reading->force_n = touching ? estimate->place[2] : 0.0;
    reading->force_sd_n = fmfts_force_sd_n(&pad->parameters->message, estimate, &work->memory->contact);
    reading->force_min_n = estimate->refused ? 0.0 : estimate->force_min_n;
}

/* Of a pad without a contact model: touch and displacement, no place and no force. */
static void read_displacement(const fmfts_pad *pad, fmfts_frame_work *work, fmfts_reading *reading)
{
    fmfts_verdict *verdict = &work->step.verdict;
    fmfts_say(&verdict->reason, verdict->reason.size ? "; %s" : "%s", pad->words.no_model);
    if (work->touch_is_known) {
        reading->contact = work->memory->contact.touched != 0.0 ? FMFTS_IN_CONTACT : FMFTS_NO_CONTACT;
        reading->tells_displacement = true;
        fmfts_distance(&work->displacement, &reading->displacement_m, &reading->displacement_sd_m);
    }
}

/* Without a baseline nothing is solved, but the measured axes are reported. */
static void use_what_was_measured(fmfts_step *step)
{
    const fmfts_missing *missing = &step->missing;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        unsigned wrong = (unsigned)missing->saturated[axis / 3] | missing->untellable[axis / 3];
        step->verdict.used[axis] = !missing->silent[axis / 3] && !(wrong >> axis % 3 & 1);
    }
}

unsigned fmfts_sensors_used(const fmfts_step *step)
{
    const bool *used = step->verdict.used;
    unsigned mask = 0;
    for (int i = 0; i < (int)step->parameters->sensors; i++) {
        mask |= (unsigned)(used[3 * i] && used[3 * i + 1] && used[3 * i + 2]) << i;
    }
    return mask;
}

/* Whether the frame has a pose that neighbours may use, with a known touch or a contact. */
static bool has_contact(const fmfts_pad *pad, const fmfts_frame_work *work)
{
    const fmfts_verdict *verdict = &work->step.verdict;
    bool is_trusted = verdict->has_estimate && verdict->health != FMFTS_DISTURBED && pad->parameters->pose.at_rest != 0.0;
    return is_trusted && (work->has_estimate || pad->parameters->message.has_model == 0.0);
}

void fmfts_read(const fmfts_pad *pad, fmfts_frame_work *work, fmfts_reading *reading)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_verdict *verdict = &work->step.verdict;
    bool without_rest = parameters->message.has_baseline == 0.0 || parameters->pose.at_rest == 0.0;
    reading->contact = FMFTS_NOT_KNOWN;
    reading->over_range = reading->tells_place = reading->tells_force = reading->tells_force_min = false;
    reading->tells_displacement = false;
    if (parameters->message.has_baseline == 0.0) {
        use_what_was_measured(&work->step);
    }
    if (without_rest) {
        verdict->health = FMFTS_NO_BASELINE;
        fmfts_clear(&verdict->reason);
        fmfts_say(&verdict->reason, "%s", pad->words.no_baseline);
    } else if (has_contact(pad, work) && !work->has_estimate) {
        read_displacement(pad, work, reading);
    } else if (work->has_estimate && work->touch_is_known) {
        read_contact(pad, work, reading);
    }
    reading->tells_pose = verdict->has_estimate;
    if (reading->tells_pose) {
        read_pose(&parameters->message, &work->step, reading);
    }
    reading->health = verdict->health;
    reading->reason = verdict->reason;
    reading->missing = work->step.missing;
    reading->sensors_ok = fmfts_sensors_used(&work->step);
    reading->temperature_c = work->step.temperature_c;
}

void fmfts_show_others(const fmfts_pad *pad, const fmfts_frame_work *work)
{
    const fmfts_step *step = &work->step;
    if (!has_contact(pad, work)) {
        return;
    }
    memcpy(pad->own.last, step->memory->state, FMFTS_PLACED * sizeof(double));
    for (int i = 0; i < FMFTS_MOVES; i++) {
        memcpy(pad->own.covariance + FMFTS_MOVES * i, step->pose.covariance + FMFTS_STEP * i, FMFTS_MOVES * sizeof(double));
    }
    *pad->own.time_ns = (double)work->memory->message.sampled_ns;
}
