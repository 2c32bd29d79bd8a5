/* Interpolates the samples of chips that run on their own clocks to one instant.
 *
 * The samples of a frame are up to one period (4.5 ms) apart; in that time a tap changes the field by more than its noise. The
 * instant is the newest that every chip has passed, so it lies between two samples of each chip. Interpolation adds no noise; it
 * neglects only the curvature of the motion, which is added to the deviation. */
#include "push.h"

#include <math.h>
#include <string.h>

/* Shares of the time after which a chip has stopped. After 1.5 periods without a frame, one was lost or dropped. Then a
 * sample half a period later than the last one is also new: the frame that held it first never arrived. */
#define GAP_SHARE 0.6
#define UNSEEN_SHARE 0.2
/* If a chip had no new sample for this many frames or frame periods, its next sample counts as old. Periods count too,
 * because an overloaded computer drops frames. */
enum { MOST_WITHOUT_NEWS = 3 };

fmfts_periods fmfts_periods_of(double period_us)
{
    double stopped_us = FMFTS_STOPPED_PERIODS * period_us;
    return (fmfts_periods){
        .stopped_us = stopped_us,
        .longest_gap_us = stopped_us > FMFTS_LONGEST_GAP_US ? stopped_us : FMFTS_LONGEST_GAP_US,
        .old_us = (MOST_WITHOUT_NEWS + 1) * period_us,
    };
}

int64_t fmfts_latest(size_t count, const int64_t *time_us)
{
    int64_t most = time_us[0];
    for (size_t i = 1; i < count; i++) {
        most = time_us[i] > most ? time_us[i] : most;
    }
    return most;
}

/* Short steps forward are gaps, whose lengths the samples' times show. For other steps the host's clock shows how much
 * time passed. While a computer is suspended that clock stands; then the frames' numbers give the time. */
int64_t fmfts_leap_us(const fmfts_last *last, int64_t frame_us, int64_t host_ns, int64_t sequence, double period_us)
{
    int64_t there_us = frame_us - last->frame_us, passed_ns = host_ns - last->stood_ns, frames = sequence - last->stood_sequence;
    if (!last->stood_ns || (0 <= there_us && (double)there_us <= FMFTS_LONGEST_GAP_US)) {
        return 0;
    }
    int64_t passed_us = passed_ns > 0 ? passed_ns / 1000 : 0;
    if (there_us < 0) {
        return there_us - passed_us;
    }
    int64_t made_us = llrint(fmin((double)(frames > 0 ? frames : 0) * period_us, 0x1p53)); /* a board's time is less */
    int64_t beyond_us = there_us - (passed_us > made_us ? passed_us : made_us);
    return beyond_us > 0 ? beyond_us : 0;
}

static bool is_timed(const fmfts_pushed *frame, size_t sensor)
{
    return !frame->timed || frame->timed[sensor];
}

/* Forgets all samples if the board's clock restarted, or no frame came for long. Returns whether it restarted. */
static bool forget_before_gap(const fmfts_periods *periods, fmfts_samples *samples, const fmfts_pushed *frame)
{
    size_t sensors = samples->sensors;
    bool any = false, began = false;
    int64_t newest = 0;
    for (size_t i = 0; i < sensors; i++) {
        began |= samples->time_us[i] != 0;
        if (is_timed(frame, i)) {
            newest = !any || frame->time_us[i] > newest ? frame->time_us[i] : newest;
            any = true;
        }
    }
    if (!any || !began) {
        return false;
    }
    double later_us = (double)(newest - fmfts_latest(sensors, samples->time_us));
    bool began_anew = later_us < -periods->stopped_us;
    if (began_anew || later_us > periods->longest_gap_us) {
        memset(samples->time_us, 0, 3 * sensors * sizeof(int64_t));
        for (size_t i = 0; i < 9 * sensors; i++) {
            samples->field_t[i] = NAN;
        }
    }
    return began_anew;
}

/* Whether a frame was lost, so that samples that are not fresh may be new. */
static bool has_gap(const fmfts_periods *periods, const fmfts_samples *samples, const fmfts_pushed *frame)
{
    bool any = false;
    int64_t newest = 0;
    for (size_t i = 0; i < samples->sensors; i++) {
        if (frame->fresh[i]) {
            newest = !any || frame->time_us[i] > newest ? frame->time_us[i] : newest;
            any = true;
        }
    }
    int64_t before = fmfts_latest(samples->sensors, samples->time_us);
    return any && (double)(newest - before) > GAP_SHARE * periods->stopped_us;
}

/* Puts the new samples into the memory. */
static void remember(const fmfts_periods *periods, fmfts_samples *samples, const fmfts_pushed *frame)
{
    size_t sensors = samples->sensors;
    bool lost = has_gap(periods, samples, frame), any = false;
    for (size_t i = 0; i < sensors; i++) {
        double *field = samples->field_t + 3 * i;
        int64_t *time = samples->time_us + i;
        bool is_new = frame->fresh[i];
        if (lost && !is_new && is_timed(frame, i)) {
            is_new = (double)(frame->time_us[i] - time[0]) > UNSEEN_SHARE * periods->stopped_us;
        }
        if (!is_new) {
            continue;
        }
        any = true;
        memcpy(field + 6 * sensors, field + 3 * sensors, 3 * sizeof(double));
        memcpy(field + 3 * sensors, field, 3 * sizeof(double));
        memcpy(field, frame->field_t + 3 * i, 3 * sizeof(double));
        time[2 * sensors] = time[sensors];
        time[sensors] = time[0];
        time[0] = frame->time_us[i];
        for (size_t axis = 0; axis < 3; axis++) {
            int64_t *repeats = samples->repeats + 3 * i + axis;
            *repeats = field[axis] == field[3 * sensors + axis] ? *repeats + 1 : 0;
        }
    }
    samples->without_news = any ? 0 : samples->without_news + 1;
}

/* Whether a sensor's newest sample is near those of the others, and this frame contains a sample of it. */
static bool is_running(const fmfts_periods *periods, const fmfts_samples *samples, const fmfts_pushed *frame, size_t sensor,
                       int64_t newest)
{
    const double *field = frame->field_t + 3 * sensor;
    bool there = isfinite(field[0]) || isfinite(field[1]) || isfinite(field[2]);
    return there && (double)(newest - samples->time_us[sensor]) <= periods->stopped_us;
}

/* Of three samples of one sensor. behind: how far the newest is after the instant; gaps: between the samples. */
typedef struct {
    double behind, gap, gap_before, share, reach;
    bool linear;
} between;

static between between_samples(const int64_t *time, size_t sensors, int64_t instant)
{
    int64_t behind = time[0] - instant, gap = time[0] - time[sensors], before = time[sensors] - time[2 * sensors];
    gap = gap > 1 ? gap : 1;
    before = before > 1 ? before : 1;
    double share = (double)behind / (double)gap;
    share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
    int64_t ahead = gap - behind > 0 ? gap - behind : 0;
    return (between){
        .behind = (double)behind,
        .gap = (double)gap,
        .gap_before = (double)before,
        .share = share,
        .reach = 2.0 * (double)behind * (double)ahead / (double)(gap + before),
        .linear = time[sensors] > 0,
    };
}

static void interpolate(const fmfts_samples *samples, size_t axis, const between *b, fmfts_aligned *aligned)
{
    size_t axes = 3 * samples->sensors;
    double newest = samples->field_t[axis], previous = samples->field_t[axes + axis],
           oldest = samples->field_t[2 * axes + axis], share = b->share;
    bool linear = b->linear && isfinite(previous);
    double slopes = (newest - previous) / b->gap - (previous - oldest) / b->gap_before;
    double bend = fabs(b->reach * slopes), jump = fabs(slopes) * b->gap;
    if (jump > FMFTS_JUMP_T && share > 0.0) {
        bend = (share > 1.0 - share ? share : 1.0 - share) * jump;
    }
    if (!isfinite(bend)) { /* without a third sample the step itself bounds the error */
        double step = fabs(share * (newest - previous));
        bend = isfinite(step) ? step : 0.0;
    }
    aligned->field_t[axis] = linear ? (1.0 - share) * newest + share * previous : newest;
    aligned->bend_t[axis] = bend;
}

static void tell_nothing(size_t sensors, fmfts_aligned *aligned)
{
    for (size_t axis = 0; axis < 3 * sensors; axis++) {
        aligned->field_t[axis] = aligned->bend_t[axis] = NAN;
        aligned->noise_share[axis / 3] = 1.0;
    }
}

void fmfts_push(const fmfts_periods *periods, fmfts_samples *samples, const fmfts_pushed *frame, fmfts_aligned *aligned)
{
    size_t sensors = samples->sensors;
    aligned->began_anew = forget_before_gap(periods, samples, frame);
    remember(periods, samples, frame);
    memcpy(aligned->repeats, samples->repeats, 3 * sensors * sizeof(int64_t));
    int64_t newest = fmfts_latest(sensors, samples->time_us), instant = newest;
    aligned->is_old = samples->without_news > MOST_WITHOUT_NEWS ||
                      (samples->without_news && frame->has_time && (double)(frame->frame_us - newest) > periods->old_us);
    bool any = false;
    for (size_t i = 0; i < sensors; i++) {
        if (is_running(periods, samples, frame, i, newest)) {
            instant = samples->time_us[i] < instant ? samples->time_us[i] : instant;
            any = true;
        }
    }
    aligned->time_us = newest;
    if (!any || aligned->is_old) {
        tell_nothing(sensors, aligned);
        return;
    }
    aligned->time_us = instant;
    for (size_t i = 0; i < sensors; i++) {
        between b = between_samples(samples->time_us + i, sensors, instant);
        bool runs = is_running(periods, samples, frame, i, newest);
        aligned->noise_share[i] = sqrt(b.share * b.share + (1.0 - b.share) * (1.0 - b.share));
        for (size_t axis = 3 * i; axis < 3 * i + 3; axis++) {
            interpolate(samples, axis, &b, aligned);
            aligned->field_t[axis] = runs ? aligned->field_t[axis] : NAN;
            aligned->bend_t[axis] = runs ? aligned->bend_t[axis] : 0.0; /* an unpublished axis has no error */
        }
    }
}
