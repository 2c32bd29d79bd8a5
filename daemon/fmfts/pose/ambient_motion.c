/* Detects that an ambient field moves although the scene calls it constant: a turning robot is no broken sensor. */
#include "model.h"
#include "tracking.h"

/* While frames are not ok, one in EVERY is solved again, and LOOKS of them decide: 0.4 s at 220 Hz. A turning pad passes
 * through the orientation of its baseline: only after a second of ok frames does it count as ok. */
enum { EVERY = 8, LOOKS = 12, WELL_FRAMES = 220 };
/* The offset of a faulty sensor stays constant. A field that moves by more than both limits (5 mG) shows a moving robot. */
#define MOVED_DEVIATIONS 6.0
#define MOVED_T 5e-7
/* Stop if one more step would lower χ² by less than this: the rest is a thirtieth of a standard deviation. */
#define STOP_CHI2 1e-3

static void forget(fmfts_pose_memory *memory)
{
    memory->explained = 0;
    memory->moved_t = 0.0;
    for (int i = 0; i < 3; i++) {
        memory->lowest_t[i] = INFINITY;
        memory->highest_t[i] = -INFINITY;
    }
}

static bool is_whole(const fmfts_step *step)
{
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        if (!isfinite(step->field.field_t[axis])) {
            return false;
        }
    }
    return true;
}

/* Solves for pose and ambient field, from rest, with the moment of the rest pose. deviation_t: that of the ambient field. False
 * if these do not explain the frame. */
static bool is_explained(const fmfts_step *step, double ambient_t[3], double *deviation_t)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    const double magnet[FMFTS_MAGNET] = {parameters->strength_t_m3, parameters->octupole_m2};
    double rows[FMFTS_AXES * FMFTS_MEASUREMENT], work[FMFTS_WORK(FMFTS_AXES)], state[FMFTS_STATE];
    double covariance[FMFTS_STEP * FMFTS_STEP], direction[FMFTS_STEP], variance = 0.0;
    uint8_t parts[FMFTS_STEP];
    fmfts_write_measurements(step, step->field.field_t, rows);
    for (int c = 0; c < FMFTS_STEP; c++) {
        parts[c] = c != LOG_COLUMN && c < GRADIENT_COLUMN ? FMFTS_FREE : FMFTS_FIXED;
    }
    const fmfts_problem problem = {.measurements = rows,
                                   .rows = 3 * (size_t)parameters->sensors,
                                   .magnets = magnet,
                                   .magnet_count = 1,
                                   .parts = parts,
                                   .start = parameters->rest,
                                   .stop_chi2 = STOP_CHI2,
                                   .max_iterations = FMFTS_MAX_ITERATIONS};
    fmfts_summary found = fmfts_solve(&problem, work, state, covariance, direction);
    for (int i = 0; i < 3; i++) {
        ambient_t[i] = state[AMBIENT_VALUE + i];
        variance += covariance[(FMFTS_STEP + 1) * (AMBIENT_COLUMN + i)];
    }
    *deviation_t = sqrt(variance);
    return found.status == FMFTS_CONVERGED && found.rows > found.unknowns &&
           found.chi2 < parameters->motion_chi2[found.rows - found.unknowns];
}

/* How many of the last examined frames the ambient field explains. */
static int explained_of(const fmfts_pose_memory *memory)
{
    int count = 0;
    for (int i = 0; i < LOOKS; i++) {
        count += (int)(memory->explained >> i & 1);
    }
    return count;
}

static void look_again(const fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    double ambient_t[3], deviation_t, square = 0.0;
    if (!is_whole(step)) {
        return;
    }
    bool explains = is_explained(step, ambient_t, &deviation_t);
    memory->explained = (memory->explained << 1 | explains) & ((1 << LOOKS) - 1);
    if (!explains) {
        return;
    }
    for (int i = 0; i < 3; i++) {
        memory->lowest_t[i] = fmin(memory->lowest_t[i], ambient_t[i]);
        memory->highest_t[i] = fmax(memory->highest_t[i], ambient_t[i]);
        double range_t = memory->highest_t[i] - memory->lowest_t[i];
        square += range_t * range_t;
    }
    double moved_t = sqrt(square);
    if (explained_of(memory) >= LOOKS - 1 && moved_t > fmax(MOVED_T, MOVED_DEVIATIONS * deviation_t)) {
        memory->moved_t = fmax(memory->moved_t, moved_t);
    }
}

static void follow(const fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    memory->frames_seen++;
    if (step->verdict.stronger) { /* an ambient field this large would also explain steel on a finger */
        forget(memory);
    } else if (step->verdict.health == FMFTS_OK) {
        memory->well_frames++;
        if (memory->well_frames >= WELL_FRAMES) {
            forget(memory);
        }
    } else {
        memory->well_frames = 0;
        if (memory->frames_seen % EVERY == 0) {
            look_again(step);
        }
    }
}

void fmfts_watch_ambient(fmfts_step *step)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_verdict *verdict = &step->verdict;
    if (parameters->at_rest == 0.0 || parameters->part[AMBIENT_COLUMN] != FMFTS_FIXED) {
        return;
    }
    follow(step);
    if (step->memory->moved_t > 0.0) {
        verdict->health = FMFTS_DISTURBED;
        verdict->has_estimate = verdict->stronger = false;
        fmfts_clear(&verdict->reason);
        fmfts_say(&verdict->reason,
                  "the ambient field moves, by %.0f mG, and scene.ambient = \"constant\" says that it does not: where the pad "
                  "turns, or a magnet moves far off, set ambient = \"drifting\" in [pad.scene]",
                  step->memory->moved_t * 1e7);
        for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
            verdict->used[axis] = isfinite(step->field.field_t[axis]);
        }
    }
}
