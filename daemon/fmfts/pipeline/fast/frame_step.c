/* For a healthy frame, the steps of Estimator.read and the numbers of contact_message.py. */
#include <math.h>
#include <string.h>

#include "../../pose/model.h"
#include "../../sensor/wire/sample.h"
#include "frame_step.h"

#define MM_PER_M 1e3

static bool has_all_readings(const fmfts_pose_parameters *parameters, size_t readings_bytes)
{
    double sensors = parameters->sensors[0];
    return sensors >= 1 && sensors <= FMFTS_SENSORS && readings_bytes == FMFTS_READING_BYTES * (size_t)sensors;
}

/* Whether a temperature is missed: Estimator counts for how long. */
static bool misses_temperature(const fmfts_pose_parameters *parameters, double temperature_c)
{
    return isnan(temperature_c) && !isnan(parameters->rest_temperature_c[0]);
}

/* Whether no sensor and no axis is missing: else Python forgot `now`, which is not told. */
static bool is_whole(const fmfts_pose_memory *memory)
{
    return memory->gain_code[0] < 0.0;
}

/* _pose_message of contact_message.py */
static void put_pose(const fmfts_message_parameters *parameters, const double *state, const fmfts_pose *pose,
                      fmfts_numbers *n)
{
    const double *own = pose->covariance;
    double deviation[6];
    for (int i = 0; i < 6; i++) {
        deviation[i] = sqrt(own[(FMFTS_STEP + 1) * i] + parameters->rest_variance[i]);
    }
    for (int i = 0; i < 3; i++) {
        int c = AMBIENT_COLUMN + i;
        n->position_m[i] = state[i];
        n->position_sd_m[i] = deviation[i];
        n->axis[i] = state[AXIS_VALUE + i];
        n->ambient_t[i] = parameters->ambient_t[i] + state[AMBIENT_VALUE + i];
        n->ambient_sd_t[i] = sqrt(parameters->ambient_variance[i] + own[(FMFTS_STEP + 1) * c]);
    }
    n->axis_sd_rad[0] = fmax(deviation[3], deviation[4]);
    n->remanence_t[0] = parameters->remanence_t[0] * fmfts_exp(state[LOG_VALUE]);
    n->remanence_sd_t[0] = deviation[5] * n->remanence_t[0];
    n->residual_t[0] = pose->residual_t;
    n->chi2[0] = pose->chi2;
}

/* deviations.py */
static double quiet_force_sd_n(double force_sd_n, double detection_limit_n)
{
    double uniform_sd_n = detection_limit_n / sqrt(3.0);
    return sqrt(force_sd_n * force_sd_n + uniform_sd_n * uniform_sd_n);
}

double fmfts_force_sd_n(const fmfts_message_parameters *parameters, const fmfts_estimate *estimate, const fmfts_contact_memory *touch)
{
    double limit_n = parameters->detection_limit_n[0], force_n = estimate->place[2];
    if (touch->touched[0] == 0.0) {
        return quiet_force_sd_n(estimate->central_force_sd_n, limit_n);
    }
    double deviation_n = quiet_force_sd_n(estimate->deviation[2], estimate->doubt * limit_n);
    return touch->in_contact[0] != 0.0 ? deviation_n : sqrt(deviation_n * deviation_n + force_n * force_n);
}

static fmfts_kind put_contact(const fmfts_message_parameters *parameters, const fmfts_estimate *estimate,
                               const fmfts_contact_memory *touch, fmfts_numbers *n)
{
    bool touching = touch->in_contact[0] != 0.0;
    n->x_m[0] = estimate->place[0];
    n->x_sd_m[0] = estimate->deviation[0];
    n->y_m[0] = estimate->place[1];
    n->y_sd_m[0] = estimate->deviation[1];
    n->force_n[0] = touching ? estimate->place[2] : 0.0;
    n->force_min_n[0] = estimate->force_min_n;
    n->shear_x_n[0] = estimate->outputs > 3 ? estimate->place[3] : 0.0;
    n->shear_x_sd_n[0] = estimate->outputs > 3 ? estimate->deviation[3] : 0.0;
    n->shear_y_n[0] = estimate->outputs > 3 ? estimate->place[4] : 0.0;
    n->shear_y_sd_n[0] = estimate->outputs > 3 ? estimate->deviation[4] : 0.0;
    n->force_sd_n[0] = fmfts_force_sd_n(parameters, estimate, touch);
    return !touching ? FMFTS_QUIET : estimate->over_range ? FMFTS_OVER_RANGE : FMFTS_TOUCHED;
}

static bool all_finite(const fmfts_numbers *numbers, bool with_temperature, bool with_ambient)
{
    double sum = with_temperature ? numbers->temperature_c[0] : 0.0;
    const double *first = numbers->x_m, *ambient = numbers->ambient_t, *last = (const double *)(numbers + 1);
    for (const double *number = first; number < last; number++) {
        sum += with_ambient || number < ambient || number >= numbers->residual_t ? *number : 0.0;
    }
    return isfinite(sum);
}

/* Solves the frame's field for the magnet's state, beside its neighbours. */
static bool solve(const fmfts_pad *pad, const fmfts_frame *frame, fmfts_pose_memory *next, fmfts_field *field,
                  double slopes[][FMFTS_STEP], fmfts_pose *pose)
{
    const fmfts_pose_parameters *parameters = &pad->parameters->pose;
    fmfts_felt felt;
    if (!fmfts_align(parameters, next, frame, field)) {
        return false;
    }
    fmfts_feel(parameters, pad->neighbour, (double)fmfts_sampled_ns(frame->host_ns, frame->time_us, field->instant_us), &felt);
    if (felt.count) {
        fmfts_add_neighbours(parameters, &felt, field);
    }
    const fmfts_reference reference = fmfts_reference_beside(parameters, &felt);
    return fmfts_track(parameters, next, &felt, field, frame->temperature_c, pose) &&
           fmfts_judge_residuals(parameters, next, field, slopes) &&
           fmfts_follow_foreign(parameters, &reference, next, pose);
}

/* The contact from a change of pose. False if only Python can say it. */
static bool estimate_contact(const fmfts_pad *pad, fmfts_memory *next, const fmfts_pose *pose,
                             const fmfts_displacement *displacement, fmfts_estimate *estimate)
{
    const fmfts_contact_parameters *contact = &pad->parameters->contact;
    fmfts_question question;
    fmfts_draw(&pad->parameters->pose, next->pose.state, displacement, MM_PER_M, question.pose, question.covariance);
    return fmfts_smooth(contact, &next->contact, pose->elapsed_s, &question) && fmfts_keep_inside(contact, &question) &&
           fmfts_estimate_contact(contact, &question, &pad->network, contact->refine_steps[0] > 0.0 ? pad->response : NULL,
                                  pad->response_bytes, estimate) &&
           !(estimate->refused && next->contact.touched[0] != 0.0); /* Python says that the place is not known */
}

int64_t fmfts_sampled_ns(int64_t host_ns, double time_us, double instant_us)
{
    return host_ns - 1000 * ((int64_t)time_us - (int64_t)instant_us);
}

void fmfts_go_on(const fmfts_pad *pad, const fmfts_outcome *outcome, int64_t sampled_ns, fmfts_memory *memory)
{
    *memory = outcome->next;
    memcpy(pad->own->last, outcome->next.pose.state, sizeof pad->own->last);
    memcpy(pad->own->covariance, outcome->seen, sizeof pad->own->covariance);
    pad->own->time_ns[0] = (double)sampled_ns;
}

fmfts_kind fmfts_frame_step(const fmfts_pad *pad, const fmfts_memory *memory, const fmfts_frame *frame, size_t readings_bytes,
                            fmfts_outcome *outcome)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_memory *next = &outcome->next;
    fmfts_numbers *numbers = &outcome->numbers;
    fmfts_field field;
    fmfts_pose pose;
    fmfts_displacement displacement;
    fmfts_estimate estimate;
    double slopes[FMFTS_AXES][FMFTS_STEP], overlap[5][5];
    memcpy(next, memory, sizeof *next);
    outcome->judged.known = 0;
    if (!has_all_readings(&parameters->pose, readings_bytes) ||
        misses_temperature(&parameters->pose, frame->temperature_c) ||
        !solve(pad, frame, &next->pose, &field, slopes, &pose)) {
        return FMFTS_NO_NUMBER;
    }
    const double *state = next->pose.state;
    fmfts_follow_creep(&parameters->pose, &next->pose, pose.elapsed_s);
    bool is_alone = parameters->pose.neighbours[0] == 0.0, overlaps = is_whole(&next->pose) && is_alone; /* Estimator._counted */
    if (overlaps) {
        fmfts_overlap(&parameters->pose, &next->pose, &field, (const double(*)[FMFTS_STEP])slopes, overlap);
    }
    fmfts_displace(&parameters->pose, &next->pose, state, &pose, overlaps ? (const double(*)[5])overlap : NULL,
                   &displacement);
    if (!fmfts_touch(&parameters->contact, &next->contact, displacement.change, displacement.at_rest,
                     pose.elapsed_s)) {
        return FMFTS_NO_NUMBER;
    }
    bool has_model = parameters->message.has_model[0] != 0.0;
    if (has_model) {
        if (!estimate_contact(pad, next, &pose, &displacement, &estimate)) {
            return FMFTS_NO_NUMBER;
        }
        fmfts_press(&parameters->contact, &next->contact, &estimate);
    }
    if (has_model && parameters->now.tells_now[0] != 0.0 && is_whole(&next->pose) && is_alone &&
        !fmfts_tell_now(pad, next, frame, &pose, &estimate, outcome)) {
        return FMFTS_NO_NUMBER;
    }
    outcome->instant_us = field.instant_us;
    numbers->temperature_c[0] = frame->temperature_c;
    put_pose(&parameters->message, state, &pose, numbers);
    for (int i = 0; i < FMFTS_MOVES; i++) {
        memcpy(outcome->seen + FMFTS_MOVES * i, pose.covariance + FMFTS_STEP * i, FMFTS_MOVES * sizeof(double));
    }
    fmfts_kind kind = next->contact.touched[0] != 0.0 ? FMFTS_TOUCHED : FMFTS_QUIET;
    if (has_model) {
        kind = put_contact(&parameters->message, &estimate, &next->contact, numbers);
    } else {
        fmfts_distance(&displacement, numbers->displacement_m, numbers->displacement_sd_m);
    }
    bool is_healthy = all_finite(numbers, !isnan(frame->temperature_c), !isnan(parameters->message.ambient_t[0]));
    bool is_doubtful = kind == FMFTS_OVER_RANGE && fmfts_has_jumped(&parameters->pose, &field);
    return is_healthy && !is_doubtful ? kind : FMFTS_NO_NUMBER;
}
