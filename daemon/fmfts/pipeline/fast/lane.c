/* Turns the bytes of one healthy frame into its message. */
#define _POSIX_C_SOURCE 199309L /* clock_gettime */
#include "lane.h"

#include <math.h>
#include <string.h>
#include <time.h>

#include "../../sensor/wire/sample.h"

enum { MOST_MISSING = 1000 }; /* frames; after more, or a repeated one, Python decides (statistics.py) */

static double temperature_c(const fmfts_lane *lane, const fmfts_sample *sample)
{
    const fmfts_pose_parameters *pose = &lane->pad.parameters->pose;
    return fmfts_temperature_c(sample, pose->at_zero_c[0], pose->c_per_count[0], pose->range_c);
}

/* Whether the sample is this pad's next one, and has a temperature exactly if the template has one (its first number). */
static bool is_expected(const fmfts_lane *lane, const fmfts_sample *sample)
{
    bool has_temperature = lane->message[lane->kind].place[FMFTS_MESSAGE_INTEGERS] >= 0;
    return sample->pad_index == lane->pad_index && has_temperature == !isnan(temperature_c(lane, sample)) &&
           sample->sequence - lane->sequence - 1 < MOST_MISSING && lane->passed < FMFTS_TALLIED;
}

/* Solves the sample up to its contact, into the pad's outcome. host_ns: its time on the host's clock. */
static fmfts_kind step(const fmfts_lane *lane, const fmfts_sample *sample, int64_t host_ns)
{
    const fmfts_frame frame = {
        .readings = sample->readings,
        .time_us = (double)sample->time_us,
        .sequence = (double)sample->sequence,
        .temperature_c = temperature_c(lane, sample),
        .host_ns = host_ns,
        .gain_code = sample->gain_code,
        .valid = sample->valid,
        .fresh = sample->fresh,
    };
    return fmfts_frame_step(&lane->pad, lane->memory, &frame, FMFTS_READING_BYTES * (size_t)sample->sensors, lane->outcome);
}

static bool may_publish(const fmfts_lane *lane, fmfts_kind kind)
{
    return kind == lane->kind ||
           (kind != FMFTS_NO_NUMBER && lane->message[kind].text != NULL && lane->changes < FMFTS_CHANGES);
}

int64_t fmfts_now_ns(int clock)
{
    struct timespec now;
    clock_gettime((clockid_t)clock, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void tally(fmfts_lane *lane, const fmfts_sample *sample, int64_t arrival_ns)
{
    if (lane->passed == 0) {
        lane->first_sequence = sample->sequence;
    }
    lane->sequence = sample->sequence;
    lane->arrival_ns = arrival_ns;
    lane->frame_us = (int64_t)sample->time_us;
    lane->latency_s[lane->passed++] = (double)(lane->t_publish_ns - lane->t_sample_ns) * 1e-9;
}

static void write_message(fmfts_lane *lane, fmfts_kind kind)
{
    const fmfts_template *message = &lane->message[kind];
    const unsigned long long integer[FMFTS_MESSAGE_INTEGERS] = {
        lane->number, (unsigned long long)lane->t_sample_ns, (unsigned long long)lane->t_publish_ns,
        (unsigned long long)fmfts_now_ns(CLOCK_REALTIME), (unsigned long long)lane->t_now_ns};
    fmfts_write_numbers(message->text, message->size, message->place, integer, &lane->outcome->numbers);
    if (kind != lane->kind) {
        lane->kind = kind;
        memcpy(lane->change + lane->changes * lane->change_room, message->text, message->size);
        lane->change_bytes[lane->changes++] = message->size;
    }
}

/* A sample that came before its frame: the last message again, with another `now`. */
static fmfts_verdict handle_early(fmfts_lane *lane, const fmfts_early_sample *sample, int64_t arrival_ns)
{
    fmfts_early early = {.sensor = sample->sensor, .time_us = (double)sample->time_us};
    int64_t now_ns = fmfts_now_ns(CLOCK_MONOTONIC);
    if (sample->pad_index != lane->pad_index || sample->sensor >= (unsigned)lane->pad.parameters->pose.sensors[0] ||
        !fmfts_is_plausible(lane->clock, (int64_t)sample->time_us, arrival_ns)) {
        return FMFTS_FOR_PYTHON;
    }
    if (now_ns - lane->frame_ns - 1000 * ((int64_t)sample->time_us - lane->frame_us) > lane->overdue_ns) {
        return FMFTS_SILENT;
    }
    fmfts_read_early(&lane->pad.parameters->pose, sample->gain_code, sample->counts, early.field_t);
    if (fmfts_early_step(&lane->pad, lane->memory, &early, lane->outcome) != FMFTS_TOLD) {
        return FMFTS_SILENT;
    }
    lane->number++;
    lane->early++;
    lane->t_now_ns = lane->frame_ns + (int64_t)((lane->outcome->now_us - (double)lane->frame_us) * 1000.0);
    lane->t_publish_ns = now_ns;
    write_message(lane, lane->kind);
    return FMFTS_WRITTEN;
}

fmfts_verdict fmfts_handle_line(fmfts_lane *lane, const uint8_t *line, size_t size, int64_t arrival_ns)
{
    fmfts_sample sample;
    fmfts_early_sample early;
    fmfts_kind kind;
    int64_t host_ns;
    if (fmfts_read_early_sample(line, size, &early)) {
        return handle_early(lane, &early, arrival_ns);
    }
    if (!fmfts_read_sample(line, size, &sample) || !is_expected(lane, &sample)) {
        return FMFTS_FOR_PYTHON;
    }
    fmfts_clock_line clock = *lane->clock; /* of a frame that Python reads again, the clock must not have learned */
    if (!fmfts_host_time(&clock, (int64_t)sample.time_us, arrival_ns, &host_ns) ||
        !may_publish(lane, kind = step(lane, &sample, host_ns))) {
        lane->outcome->judged.known = 0; /* the outcome may be of a frame that Python refuses */
        return FMFTS_FOR_PYTHON;
    }
    *lane->clock = clock;
    int64_t now_ns = fmfts_now_ns(CLOCK_MONOTONIC);
    if (now_ns - host_ns > lane->overdue_ns) {
        lane->outcome->judged.known = 0; /* the outcome is of a frame that the memory has not */
        return FMFTS_OVERDUE;
    }
    lane->number++;
    lane->t_sample_ns = fmfts_sampled_ns(host_ns, (double)sample.time_us, lane->outcome->instant_us);
    fmfts_go_on(&lane->pad, lane->outcome, lane->t_sample_ns, lane->memory);
    lane->t_now_ns = host_ns + (int64_t)((lane->outcome->now_us - (double)sample.time_us) * 1000.0);
    lane->t_publish_ns = now_ns;
    lane->frame_ns = host_ns;
    write_message(lane, kind);
    tally(lane, &sample, arrival_ns);
    return FMFTS_WRITTEN;
}
