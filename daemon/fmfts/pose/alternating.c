/* Finds, while the pad runs, a field that alternates (mains, motors), or samples that scatter more than at the baseline.
 *
 * A frame is an outlier if few healthy frames have so large a χ². Outliers of a press or a fault point in one
 * direction; those of an alternating field reverse it again and again. After detection each frame solves for the
 * ambient field on its own, which does not change the pose (frame_solver.c), and χ² of all frames gives the variance
 * that remains: chips on their own clocks see another phase each, and a near motor another field (R. K. Mehra, "On the
 * identification of variances and adaptive Kalman filtering", IEEE Trans. Automatic Control 15 (1970) 175). */
#include <string.h>

#include "model.h"
#include "spectrum.h"
#include "tracking.h"

/* Detection threshold: the sum of the outliers' squares, with this memory in frames, which healthy frames exceed less
 * than once in fifty hours. No outlier counts as more than MOST_SURPRISE. */
#define ENOUGH 7.0
#define KEPT_FRAMES 40.0
#define MOST_SURPRISE 2.3
/* An outlier reverses direction if the cosine is below this: errors of a pad that differs from its baseline keep their
 * direction for a whole press. */
#define OTHER_WAY 0.5
/* After detection: frames from one spectrum to the next, and how many spectra without a line, or much noise, end it. */
enum { LOOK_EVERY = 16, QUIET_LOOKS = 12 };
/* Two sensors may be loose. Of a field that turns, single frames blame more within this many frames. */
enum { MOST_LOOSE = 2, BLAMED_FRAMES = 40 };
/* The variance follows χ², at most by a factor of MOST_RATIO in each frame, up to LARGEST_T: upwards over RISE_FRAMES,
 * and downwards over FALL_FRAMES once CALM_FRAMES passed without a rise. The phases that chips see beat with the
 * differences of their clocks: while the alternating field lasts, no calm is as long. */
#define RISE_FRAMES 8.0
#define FALL_FRAMES 32.0
#define CALM_FRAMES 256
#define MOST_RATIO 4.0
#define LARGEST_T 4e-6
/* Smallest amplitude of a line, and smallest added noise as a share of the noise, that are reported. */
#define TOLD_T 2e-7
#define TOLD_SHARE 1.0

static double mean_noise_t2(const fmfts_pose_parameters *parameters)
{
    int axes = 3 * (int)parameters->sensors;
    double sum = 0.0;
    for (int axis = 0; axis < axes; axis++) {
        sum += parameters->noise_t[axis] * parameters->noise_t[axis] / axes;
    }
    return sum;
}

/* Residual of each axis, and of the moment, in deviations. */
static void find_misfit(const fmfts_step *step, double misfit[FMFTS_AXES + 1])
{
    const fmfts_pose_parameters *parameters = step->parameters;
    const double *before = parameters->part[AMBIENT_COLUMN] == FMFTS_FIXED ? parameters->rest + AMBIENT_VALUE
                                                                           : step->memory->last_ambient_t;
    double moved_t[3];
    memset(misfit, 0, (FMFTS_AXES + 1) * sizeof(double));
    for (int k = 0; k < 3; k++) {
        moved_t[k] = step->nearest.state[AMBIENT_VALUE + k] - before[k];
    }
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
        double off_t = step->residual_t[axis] + dot3(parameters->direction + 3 * axis, moved_t);
        misfit[axis] = isfinite(off_t) ? off_t / sqrt(step->field.variance_t2[axis]) : 0.0;
    }
    misfit[FMFTS_AXES] = step->misfit.moment;
}

static double along(const double *a, const double *b)
{
    double sum = 0.0;
    for (int i = 0; i < FMFTS_AXES + 1; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* By how much the frame's χ² exceeds that of 99 % of healthy frames, if its direction is opposite to the last
 * outlier's. Beside steel χ² may be large although the nearest pose leaves small residuals: the direction is then that
 * of noise. */
static double turned(fmfts_step *step)
{
    double misfit[FMFTS_AXES + 1], *last = step->memory->last_surprise;
    bool is_explained = step->verdict.health == FMFTS_DEGRADED; /* residuals of an excluded sensor */
    if (is_explained || !step->misfit.known || !fmfts_surprises(step)) {
        return 0.0;
    }
    find_misfit(step, misfit);
    double size2 = along(misfit, misfit);
    double ratio = fmin(fmin(size2, step->misfit.chi2) / step->parameters->surprising_chi2[step->misfit.freedom], MOST_SURPRISE);
    bool other_way = along(misfit, last) < -OTHER_WAY * sqrt(size2 * along(last, last));
    memcpy(last, misfit, sizeof misfit);
    return other_way && ratio > 1.0 ? ratio * ratio : 0.0;
}

static void begin(fmfts_pose_memory *memory)
{
    memory->alternates = 1;
    memory->ring_frames = memory->quiet_rings = memory->calm_frames = 0;
    memory->surprises = memory->alternating_t2 = memory->line_hz = memory->line_t = 0.0;
}

static void remember_ambient(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    memmove(memory->ring_t, memory->ring_t + 3, sizeof memory->ring_t - 3 * sizeof(double));
    memcpy(memory->ring_t + 3 * (FMFTS_RING - 1), step->nearest.state + AMBIENT_VALUE, 3 * sizeof(double));
    memory->ring_frames++;
}

/* If the scene lets the ambient field move, its estimate follows a slow alternation, and no frame is an outlier. */
static bool has_line(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    if (step->parameters->part[AMBIENT_COLUMN] == FMFTS_FIXED || step->verdict.health != FMFTS_OK) {
        memory->ring_frames = 0;
        return false;
    }
    remember_ambient(step);
    if (memory->ring_frames < FMFTS_RING) {
        return false;
    }
    memory->ring_frames = 0;
    return fmfts_strongest_line(step->parameters, memory->ring_t).amplitude_t > TOLD_T;
}

void fmfts_note_blame(fmfts_pose_memory *memory, int sensor)
{
    memory->blamed[sensor] = BLAMED_FRAMES;
}

unsigned fmfts_blamed_within(const fmfts_pose_memory *memory, int frames)
{
    unsigned mask = 0;
    for (int sensor = 0; sensor < FMFTS_SENSORS; sensor++) {
        mask |= (unsigned)(memory->blamed[sensor] + frames >= BLAMED_FRAMES) << sensor;
    }
    return mask;
}

/* Where the scene holds the field fixed, a turned robot is blamed on several sensors, too. */
static bool blames_too_many(const fmfts_step *step)
{
    return step->parameters->part[AMBIENT_COLUMN] != FMFTS_FIXED &&
           fmfts_count(fmfts_blamed_within(step->memory, BLAMED_FRAMES - 1)) > MOST_LOOSE;
}

static void look_for_beginning(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    memory->surprises += turned(step) - memory->surprises / KEPT_FRAMES;
    bool is_settled = step->parameters->part[LOG_COLUMN] != FMFTS_FREE || fmfts_knows_moment(step);
    if (has_line(step) || (memory->surprises >= ENOUGH && is_settled) || blames_too_many(step)) {
        begin(memory);
    }
}

/* The variance for which χ² would equal that of healthy frames. The added part is counted three times for each axis,
 * because the errors of a chip's three axes are correlated: independent errors of three times the variance are never
 * smaller. */
static void follow_variance(fmfts_step *step)
{
    double *variance_t2 = &step->memory->alternating_t2, mean_t2 = 0.0;
    double ratio = step->misfit.known ? step->misfit.chi2 / step->misfit.freedom : MOST_RATIO;
    int axes = 3 * (int)step->parameters->sensors;
    for (int axis = 0; axis < axes; axis++) {
        mean_t2 += step->field.variance_t2[axis] / axes;
    }
    double counted_twice_t2 = (FMFTS_ALTERNATING_SHARE - 1.0) * *variance_t2;
    double missing_t2 = mean_t2 * (fmin(ratio, MOST_RATIO) - 1.0) + counted_twice_t2;
    if (missing_t2 > 0.0) {
        *variance_t2 += missing_t2 / RISE_FRAMES;
        step->memory->calm_frames = 0;
    } else if (++step->memory->calm_frames > CALM_FRAMES) {
        *variance_t2 += missing_t2 / FALL_FRAMES;
    }
    *variance_t2 = fmin(fmax(*variance_t2, 0.0), LARGEST_T * LARGEST_T);
}

static void look_at_ring(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    fmfts_line line = fmfts_strongest_line(step->parameters, memory->ring_t);
    bool is_told = line.amplitude_t > TOLD_T;
    bool is_noisy = memory->alternating_t2 > TOLD_SHARE * mean_noise_t2(step->parameters);
    memory->line_hz = is_told ? line.hz : 0.0;
    memory->line_t = is_told ? line.amplitude_t : 0.0;
    memory->quiet_rings = is_told || is_noisy ? 0 : memory->quiet_rings + 1;
    if (memory->quiet_rings >= QUIET_LOOKS) {
        memory->alternates = 0;
        memory->alternating_t2 = 0.0;
    }
}

static void follow(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    follow_variance(step);
    if (!step->nearest.known) {
        return;
    }
    remember_ambient(step);
    if (memory->ring_frames >= FMFTS_RING && memory->ring_frames % LOOK_EVERY == 0) {
        look_at_ring(step);
    }
}

static void say(fmfts_step *step)
{
    const fmfts_pose_memory *memory = step->memory;
    fmfts_text *reason = &step->verdict.reason;
    fmfts_say(reason, "%s", reason->size ? "; " : "");
    if (memory->line_hz > 0.0) {
        const fmfts_line line = {memory->line_hz, memory->line_t};
        fmfts_say_line(step->parameters, &line, reason);
        fmfts_say(reason, ": move motors, mains cables and power supplies away from the pad");
    } else {
        double noise_t = sqrt(mean_noise_t2(step->parameters) + memory->alternating_t2);
        fmfts_say(reason,
                  "the field trembles: samples scatter by %.1f µT; look for a motor near, a loose wire, or a supply that is not "
                  "clean", noise_t * 1e6);
    }
    fmfts_say(reason, "; until then deviations are larger");
    if (step->verdict.health == FMFTS_OK) {
        step->verdict.health = FMFTS_DEGRADED;
    }
}

void fmfts_watch_alternation(fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    if (step->parameters->at_rest == 0.0 || memory->without_news) {
        return;
    }
    for (int sensor = 0; sensor < FMFTS_SENSORS; sensor++) {
        memory->blamed[sensor] -= memory->blamed[sensor] > 0;
    }
    if (memory->alternates) {
        follow(step);
    } else if (step->nearest.known) {
        look_for_beginning(step);
    }
    if (step->nearest.known) {
        memcpy(memory->last_ambient_t, step->nearest.state + AMBIENT_VALUE, 3 * sizeof(double));
    }
    if (memory->alternates) {
        say(step);
    }
}
