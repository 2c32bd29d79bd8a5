#include "sensor_poll.h"

#include <string.h>

enum {
    MISSED_MAX = 3,
    UNCHANGED_MAX = 20,
    POLL_PAUSE_US = 100,
    SILENCE_US = 50000,        // eleven conversions of the HMC5983
    SILENT_PERIODS = 4,        // of chips slower than that allows
    LATE_CONVERSION_US = 3000, // beyond the trigger's `wait_us`
    BURST_US = 250,            // six bytes, with some time to spare
    CHORE_INTERVAL_US = 125000,
    READY_SURVIVES = 3, // so many probes in a row show that reading does not clear this chip's READY
};

static const uint64_t NEVER = UINT64_MAX;

static enum bus_result read_status(const struct sensor *sensor, const struct sensor_link *link,
                                   struct chip_sample *sample)
{
    const struct chip_wires wires = sensor_wires(sensor, link);
    return sensor_chip(sensor)->read_status(&wires, sample);
}

static enum bus_result read_counts(const struct sensor *sensor, const struct sensor_link *link, int16_t counts[3])
{
    const struct chip_wires wires = sensor_wires(sensor, link);
    return sensor_chip(sensor)->read_counts(&wires, counts);
}

void sensor_schedule(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us)
{
    if (sensor->phase == PHASE_CHORE)
        sensor->due_us = now_us;
    else if (link->trigger == TRIGGER_FREE)
        sensor->due_us = conversion_next_poll_us(&sensor->conversion);
    else if (sensor->awaiting)
        sensor->due_us = now_us;
    else
        sensor->due_us = NEVER;
}

static void seen_ready(struct sensor *sensor)
{
    sensor->missed = 0;
    sensor->suspect = false;
}

static uint64_t silence_us(const struct sensor *sensor)
{
    uint32_t periods_us = SILENT_PERIODS * (uint32_t)sensor->conversion.nominal_us;
    return periods_us > SILENCE_US ? periods_us : SILENCE_US;
}

static void not_ready(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us)
{
    if (link->trigger == TRIGGER_FREE && now_us > sensor->due_us + silence_us(sensor))
        sensor->conversion.ended_us = now_us; // this program polled too late; the chip was not silent
    sensor->conversion.not_ready_us = now_us;
    sensor->unchanged = 0;
    sensor->due_us = now_us + POLL_PAUSE_US;
    if (link->trigger == TRIGGER_FREE) {
        if (now_us > sensor->conversion.ended_us + silence_us(sensor))
            sensor_fail(sensor, SENSOR_NO_NEW_DATA, now_us);
        return;
    }
    sensor->suspect = true;
    const struct chip_trigger *trigger = sensor_chip(sensor)->trigger;
    if (now_us > sensor->conversion.ended_us + trigger->wait_us - trigger->conversion_us + LATE_CONVERSION_US) {
        sensor->awaiting = false;
        sensor_schedule(sensor, link, now_us);
        if (++sensor->missed >= MISSED_MAX)
            sensor_fail(sensor, SENSOR_NO_NEW_DATA, now_us);
    }
}

// The data sheet is not clear whether reading clears READY in continuous mode, or only the next conversion does. On
// chips of the second kind (`probe_ready` finds them) READY may be set for an old sample; equal bytes then mean the old
// sample.
static bool is_new(struct sensor *sensor, const int16_t counts[3], uint64_t seen_us)
{
    if (sensor->ready_survives < READY_SURVIVES || memcmp(counts, sensor->counts, sizeof sensor->counts) != 0) {
        sensor->unchanged = 0;
        return true;
    }
    if (seen_us < sensor->conversion.ended_us + sensor->conversion.period_us * 17U / 16U)
        return false;
    // Two equal samples may happen. Many of them with READY never clear mean that the chip's clock has stopped.
    if (sensor->conversion.not_ready_us < sensor->conversion.ready_us)
        sensor->unchanged++;
    return true;
}

static void accept(struct sensor *sensor, const struct sensor_link *link, const int16_t counts[3])
{
    uint64_t now_us = clock_now(link->clock);
    sensor->unaltered = memcmp(sensor->counts, counts, sizeof sensor->counts) == 0;
    memcpy(sensor->counts, counts, sizeof sensor->counts);
    sensor->awaiting = false;
    bool settled = !sensor->discard_next && sensor->conversion.ended_us >= sensor->settled_us;
    bool alive = sensor->unchanged == 0 || sensor->state == SENSOR_OK; // a chip whose clock stopped stays failed
    if (settled && alive) {
        sensor->has_sample = sensor->fresh = sensor->unsent = true;
        sensor->state = SENSOR_OK;
        sensor->failures = 0;
    }
    sensor->discard_next = false;
    if (now_us >= sensor->chore_us) {
        sensor->chore_us = now_us + CHORE_INTERVAL_US;
        sensor->phase = PHASE_CHORE;
    }
    sensor_schedule(sensor, link, now_us);
}

// If READY is set right after the data were read, reading does not clear it. Counted in a row, because a single one may
// be a new conversion.
static enum bus_result probe_ready(struct sensor *sensor, const struct sensor_link *link)
{
    struct chip_sample sample = {.status = 0};
    enum bus_result result = read_status(sensor, link, &sample);
    if (!(sample.status & CHIP_READY))
        sensor->ready_survives = 0;
    else if (sensor->ready_survives < READY_SURVIVES)
        sensor->ready_survives++;
    return result;
}

enum bus_result sensor_confirm(struct sensor *sensor, const struct sensor_link *link)
{
    struct chip_sample sample = {.status = 0};
    enum bus_result result = read_status(sensor, link, &sample);
    if (result != BUS_OK)
        return result;
    sensor->confirmed = sample.status & CHIP_READY;
    if (sensor->confirmed)
        seen_ready(sensor);
    else
        not_ready(sensor, link, clock_now(link->clock));
    return BUS_OK;
}

// The output registers hold the awaited sample only until the new conversion ends. A read burst at that moment locks
// them, and the new sample is lost. So the sample is given up if the burst would come too late, and the sensor is
// suspect.
static enum bus_result read_overtaken(struct sensor *sensor, const struct sensor_link *link)
{
    uint64_t changes_us = sensor->overtaken_us + sensor_chip(sensor)->trigger->fastest_us;
    int16_t counts[3];
    bool in_time = clock_now(link->clock) + BURST_US < changes_us;
    enum bus_result result = in_time ? read_counts(sensor, link, counts) : BUS_OK;
    if (result != BUS_OK)
        return result;
    if (in_time && clock_now(link->clock) < changes_us) {
        accept(sensor, link, counts);
        return BUS_OK;
    }
    sensor->awaiting = false;
    sensor->suspect = true;
    return BUS_OK;
}

// Whether two measurements may have ended since the last poll that found none. Chips are fast by 5 % at most; the rest is
// for the transfer of that poll.
static bool may_be_overtaken(const struct sensor *sensor, uint64_t now_us)
{
    uint32_t shortest_us = sensor->conversion.nominal_us - sensor->conversion.nominal_us / 8U;
    return now_us >= sensor->conversion.not_ready_us + shortest_us;
}

// Of a chip with `ready_held`: where another measurement ended while one was read, reads that one. It ended between the
// old and the new *seen_us; a third one does not end so soon.
static enum bus_result read_newer(struct sensor *sensor, const struct sensor_link *link, int16_t counts[3],
                                  uint64_t *seen_us)
{
    struct chip_sample newer = {.status = 0};
    enum bus_result result = read_status(sensor, link, &newer);
    if (result != BUS_OK || !(newer.status & CHIP_READY))
        return result;
    sensor->conversion.ready_us = *seen_us;
    *seen_us = clock_now(link->clock);
    return read_counts(sensor, link, counts);
}

enum bus_result sensor_poll(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip *chip = sensor_chip(sensor);
    struct chip_sample sample = {.temperature_raw = WIRE_TEMPERATURE_UNKNOWN};
    if (sensor->overtaken)
        return read_overtaken(sensor, link);
    enum bus_result result = read_status(sensor, link, &sample);
    uint64_t seen_us = clock_now(link->clock);
    if (result != BUS_OK)
        return result;
    bool ready = sample.status & CHIP_READY;
    if (ready)
        seen_ready(sensor);
    else
        not_ready(sensor, link, seen_us);
    if (!ready && !(sample.status & CHIP_LOCKED))
        return BUS_OK;
    if (chip->read_counts)
        result = read_counts(sensor, link, sample.counts); // also undoes LOCK, when only LOCK is set
    if (result == BUS_OK && ready && chip->ready_held && link->trigger == TRIGGER_FREE &&
        may_be_overtaken(sensor, clock_now(link->clock)))
        result = read_newer(sensor, link, sample.counts, &seen_us);
    if (result != BUS_OK || !ready)
        return result;
    if (sample.temperature_raw != WIRE_TEMPERATURE_UNKNOWN)
        sensor->temperature_raw = sample.temperature_raw;
    if (link->trigger == TRIGGER_FREE) {
        if (!is_new(sensor, sample.counts, seen_us)) {
            sensor->due_us = seen_us + POLL_PAUSE_US;
            return BUS_OK;
        }
        conversion_seen(&sensor->conversion, seen_us);
    }
    accept(sensor, link, sample.counts);
    if (sensor->unchanged >= UNCHANGED_MAX)
        sensor_fail(sensor, SENSOR_NO_NEW_DATA, seen_us);
    return sensor->phase == PHASE_CHORE && chip->ready_unsure ? probe_ready(sensor, link) : BUS_OK;
}
