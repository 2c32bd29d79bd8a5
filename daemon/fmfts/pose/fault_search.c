/* Finds why a frame does not fit: excludes one faulty sensor, or reports other possible causes. */
#include "../arithmetic/elementary.h"
#include "limits.h"
#include "model.h"
#include "tracking.h"

/* The suspects [mask]: without a suspect the other sensors fit better than with a foreign field. last: the last
 * suspect, with its solution. */
typedef struct {
    unsigned sensors;
    int count, last;
    fmfts_solved without_last;
} suspicion;

static void solve_with_foreign_field(const fmfts_attempt *attempt, fmfts_solved *foreign)
{
    fmfts_attempt with_field = *attempt;
    with_field.has_foreign_field = with_field.is_doubtful = true;
    fmfts_solve_frame(&with_field, foreign);
}

static void suspect_sensors(const fmfts_attempt *attempt, const fmfts_solved *foreign, suspicion *found)
{
    const fmfts_pose_parameters *parameters = attempt->step->parameters;
    double of_foreign_field = fmfts_probability(parameters, foreign);
    unsigned whole = fmfts_whole_sensors(parameters, attempt->field_t);
    found->sensors = 0;
    found->count = 0;
    if (fmfts_count(whole) <= FMFTS_FEWEST_SENSORS) {
        return;
    }
    for (int sensor = 0; sensor < (int)parameters->sensors; sensor++) {
        fmfts_attempt others = *attempt;
        fmfts_solved solved;
        others.is_doubtful = true;
        others.field_t[3 * sensor] = others.field_t[3 * sensor + 1] = others.field_t[3 * sensor + 2] = NAN;
        fmfts_solve_frame(&others, &solved);
        if (fmfts_fits(parameters, &solved, fmfts_strongest(parameters)) &&
            fmfts_probability(parameters, &solved) > of_foreign_field) {
            found->sensors |= 1u << sensor;
            found->count++;
            found->last = sensor;
            found->without_last = solved;
        }
    }
}

/* Whether one frame of a foreign field fits by chance without one sensor: a motor's field turns, and no two searches, or frames, in turn
 * then suspect the same one. */
static bool may_be_chance(const fmfts_pose_memory *memory, const suspicion *found)
{
    return memory->searched == FMFTS_NOT_ALONE || (fmfts_blamed_within(memory, 1) & ~found->sensors) ||
           (memory->searched == FMFTS_NOT_CONFIRMED && memory->searched_sensors != found->sensors);
}

/* Whether exactly one sensor is suspected, with enough evidence. */
static bool is_clear(const fmfts_step *step, const suspicion *found)
{
    return found->count == 1 && !may_be_chance(step->memory, found) &&
           (step->parameters->at_rest == 0.0 || fmfts_confirms(step->parameters, step->memory, found->last));
}

/* Leaves out the sensor that is suspected. */
static void blame(const fmfts_attempt *attempt, const fmfts_solved *whole, const suspicion *found)
{
    fmfts_step *step = attempt->step;
    int sensor = found->last;
    for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
        step->verdict.used[axis] = false;
    }
    step->verdict.health = FMFTS_DEGRADED;
    fmfts_note_blame(step->memory, sensor);
    fmfts_say(&step->verdict.reason, "sensor %d contradicts the others (χ² %.0f with it): left out", sensor + 1, whole->chi2);
    step->misfit = (fmfts_misfit){true, found->without_last.freedom, found->without_last.chi2, 0.0};
    fmfts_accept(step, attempt->prior, &found->without_last);
}

/* Whether the drift of offsets alone leaves the pose unknown: without its variance there is a pose, and with it that pose fits. */
static bool has_drifted(const fmfts_attempt *attempt)
{
    fmfts_step undrifted = *attempt->step;
    fmfts_attempt without_drift = *attempt;
    fmfts_solved solved;
    double drift_t2 = fmfts_drift_t2(attempt->step), most_share = 0.0;
    if (!(drift_t2 > 0.0)) {
        return false;
    }
    for (int axis = 0; axis < 3 * (int)undrifted.parameters->sensors; axis++) {
        double *variance_t2 = undrifted.field.variance_t2 + axis, with_drift_t2 = *variance_t2;
        *variance_t2 -= drift_t2;
        most_share = fmax(most_share, *variance_t2 / with_drift_t2);
    }
    without_drift.step = &undrifted;
    fmfts_solve_frame(&without_drift, &solved);
    solved.chi2 *= most_share; /* with the drift it is at most this */
    return fmfts_fits(undrifted.parameters, &solved, fmfts_strongest(undrifted.parameters));
}

/* The verdict if neither a pose nor a single sensor explains the frame. Two faulty sensors of four look like a foreign
 * field, and so does one of three. */
static fmfts_cause cause_of(const fmfts_attempt *attempt, const fmfts_solved *whole, const fmfts_solved *foreign,
                            const suspicion *found)
{
    const fmfts_pose_parameters *parameters = attempt->step->parameters;
    if (found->count > 0) {
        return found->count == 1 ? FMFTS_NOT_CONFIRMED : FMFTS_SENSOR_AT_FAULT;
    }
    bool explains = fmfts_fits(parameters, foreign, FMFTS_LOG_MOMENT_REACH);
    if (explains || fmfts_has_plausible_pose(parameters, whole, FMFTS_LOG_MOMENT_REACH)) {
        return FMFTS_NOT_ALONE;
    }
    return has_drifted(attempt) ? FMFTS_DRIFTED : FMFTS_NO_POSE;
}

static void say_suspects(const fmfts_step *step, fmfts_text *reason)
{
    const char *before = "sensor ";
    for (int sensor = 0; sensor < (int)step->parameters->sensors; sensor++) {
        if ((unsigned)step->memory->searched_sensors >> sensor & 1) {
            fmfts_say(reason, "%s%d", before, sensor + 1);
            before = " or ";
        }
    }
    fmfts_say(reason, " may be at fault");
}

/* whole: the sensors [mask] of the solution. */
static void say_not_alone(const fmfts_step *step, unsigned whole, fmfts_text *reason)
{
    const char *alone = "the field does not come from this magnet alone: steel, a magnet, or a turned robot";
    unsigned all = (1u << (int)step->parameters->sensors) - 1;
    int blamed = fmfts_blamed(step->memory);
    /* An excluded sensor is not the cause: without it the others do not fit either. */
    if (blamed >= 0 && !fmfts_is_missing(&step->missing, blamed)) {
        whole |= 1u << blamed;
    }
    if (whole == all) {
        fmfts_say(reason, "%s; or two sensors are wrong (run selftest)", alone);
        return;
    }
    fmfts_say_why_not(step, whole, reason);
    fmfts_say(reason, ", and %s; or another sensor is wrong (run selftest)", alone);
}

static void say_drifted(const fmfts_step *step, fmfts_text *reason)
{
    double warmed_k = step->memory->warmed_k;
    fmfts_say(reason,
              "the pad is %.0f K %s than at its baseline, and its chips' offsets may have drifted too far for a pose that is "
              "known to %.0f mm: record `fmfts-daemon baseline --rest` at this temperature",
              fabs(warmed_k), warmed_k > 0.0 ? "warmer" : "colder", FMFTS_VAGUE_M * 1e3);
}

/* The verdict by the last search. */
static void say_cause(fmfts_step *step, unsigned whole)
{
    fmfts_text *reason = &step->verdict.reason;
    step->verdict.health = FMFTS_LOST;
    switch ((fmfts_cause)step->memory->searched) {
    case FMFTS_SENSOR_AT_FAULT:
        say_suspects(step, reason);
        fmfts_say(reason, ": it is not clear which");
        break;
    case FMFTS_NOT_CONFIRMED:
        say_suspects(step, reason);
        fmfts_say(reason, ", or the field has turned");
        break;
    case FMFTS_NO_POSE:
        fmfts_say(reason, "no pose of this magnet explains the field: is the pad mounted, and is the magnet whole?");
        break;
    case FMFTS_DRIFTED:
        say_drifted(step, reason);
        break;
    case FMFTS_NOT_ALONE:
        step->verdict.health = FMFTS_DISTURBED;
        say_not_alone(step, whole, reason);
        break;
    case FMFTS_NOT_SEARCHED:
    default:
        break;
    }
}

/* The frame fits a magnet that is stronger than at its baseline. */
static void say_stronger(fmfts_step *step, const fmfts_solved *whole)
{
    double stronger = fmfts_exp(whole->state[LOG_VALUE] - step->parameters->rest[LOG_VALUE]) - 1.0;
    step->verdict.health = FMFTS_DISTURBED;
    step->verdict.stronger = true;
    fmfts_say(&step->verdict.reason,
              "the magnet looks %.0f%% stronger than its baseline says: steel touches the pad or is near it, or it is another "
              "magnet: then record `fmfts-daemon baseline --rest --replaced`",
              100.0 * stronger);
}

/* The frame fits a magnet whose strength has jumped, which only a foreign field can cause. */
static void say_unsteady(fmfts_step *step)
{
    step->verdict.health = FMFTS_DISTURBED;
    fmfts_say(&step->verdict.reason,
              "the field has leapt as no press and no warming moves it: a magnet or steel moves, or a motor or mains cable is near");
}

void fmfts_explain(const fmfts_attempt *attempt, const fmfts_solved *whole)
{
    fmfts_step *step = attempt->step;
    fmfts_pose_memory *memory = step->memory;
    if (fmfts_fits(step->parameters, whole, fmfts_strongest(step->parameters))) {
        memory->disturbed_frames++;
        fmfts_note_nearest(step, whole);
        say_unsteady(step);
        return;
    }
    if (fmfts_fits(step->parameters, whole, FMFTS_LOG_MOMENT_REACH)) {
        memory->disturbed_frames++;
        say_stronger(step, whole);
        return;
    }
    if (fmfts_has_plausible_pose(step->parameters, whole, FMFTS_LOG_MOMENT_REACH)) {
        fmfts_note_nearest(step, whole);
    }
    if (memory->disturbed_frames % FMFTS_SEARCH_EVERY == 0 || memory->searched == FMFTS_NOT_SEARCHED) {
        suspicion found;
        fmfts_solved foreign;
        solve_with_foreign_field(attempt, &foreign);
        suspect_sensors(attempt, &foreign, &found);
        if (is_clear(step, &found)) {
            blame(attempt, whole, &found);
            return;
        }
        memory->searched = cause_of(attempt, whole, &foreign, &found);
        memory->searched_sensors = found.sensors;
    }
    memory->disturbed_frames++;
    say_cause(step, fmfts_whole_sensors(step->parameters, attempt->field_t));
}
