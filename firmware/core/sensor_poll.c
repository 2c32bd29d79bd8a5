#include "sensor_poll.h"

#include <string.h>

#include "sensor_film.h"

enum {
    MISSED_MAX = 3,
    UNCHANGED_MAX = 20,
    POLL_PAUSE_US = 100,
    SILENCE_US = 50000,        // eleven conversions of the HMC5983
    SILENT_PERIODS = 4,        // periods of chips that are too slow for that
    LATE_CONVERSION_US = 3000, // beyond the trigger's `wait_us`
    BURST_US = 250,            // six bytes, with some time to spare
    READY_SURVIVES = 3, // this many probes in a row show that reading does not clear this chip's READY
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
    else if (sensor_streams(sensor, link->trigger))
        sensor->due_us = conversion_next_poll_us(&sensor->conversion);
    else if (link->trigger == TRIGGER_FREE && sensor->awaiting)
        sensor->due_us = sensor->triggered_us + sensor_chip(sensor)->trigger->wait_us;
    else if (link->trigger == TRIGGER_FREE) // a measurement may begin now, or after the pause that follows a SET
        sensor->due_us = sensor->settled_us - sensor_chip(sensor)->trigger->conversion_us;
    else
        sensor->due_us = sensor->awaiting ? now_us : NEVER;
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

// The latest time at which a triggered measurement may end. If a chip whose settings cannot be read back takes more
// than twice its time, it was reset, and measures at another bandwidth or not at all.
static uint64_t latest_us(const struct sensor *sensor)
{
    const struct chip *chip = sensor_chip(sensor);
    int late_us = chip->set ? 2 * chip->trigger->conversion_us : chip->trigger->wait_us + LATE_CONVERSION_US;
    return sensor->triggered_us + (uint64_t)late_us;
}

static void not_ready(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us)
{
    bool streams = sensor_streams(sensor, link->trigger);
    if (streams && now_us > sensor->due_us + silence_us(sensor))
        sensor->conversion.ended_us = now_us; // this program polled too late; the chip was not silent
    sensor->conversion.not_ready_us = now_us;
    sensor->unchanged = 0;
    sensor->due_us = now_us + POLL_PAUSE_US;
    if (streams) {
        if (now_us > sensor->conversion.ended_us + silence_us(sensor))
            sensor_fail(sensor, SENSOR_NO_NEW_DATA, now_us);
        return;
    }
    sensor->suspect = true;
    if (now_us <= latest_us(sensor))
        return;
    sensor->awaiting = false;
    sensor_schedule(sensor, link, now_us);
    if (++sensor->missed >= MISSED_MAX) {
        sensor_fail(sensor, SENSOR_NO_NEW_DATA, now_us);
    } else if (sensor_chip(sensor)->set) {
        (*link->config_repairs)++;
        sensor_reconfigure(sensor, now_us);
    }
}

// The data sheet is not clear whether reading clears READY in continuous mode, or only the next conversion does. On
// chips of the second kind (`probe_ready` detects them) READY may be set for an old sample; equal bytes then mean the
// old sample.
static bool is_new(struct sensor *sensor, const int16_t counts[3], uint64_t seen_us)
{
    if (sensor->ready_survives < READY_SURVIVES || memcmp(counts, sensor->counts, sizeof sensor->counts) != 0) {
        sensor->unchanged = 0;
        return true;
    }
    if (seen_us < sensor->conversion.ended_us + sensor->conversion.period_us * 17U / 16U)
        return false;
    // Two equal samples may occur. Many equal samples with READY never clear mean that the chip's clock has stopped.
    if (sensor->conversion.not_ready_us < sensor->conversion.ready_us)
        sensor->unchanged++;
    return true;
}

static bool is_settled(const struct sensor *sensor)
{
    return !sensor->discard_next && sensor->conversion.ended_us >= sensor->settled_us;
}

static void accept(struct sensor *sensor, const struct sensor_link *link, const int16_t counts[3])
{
    uint64_t now_us = clock_now(link->clock);
    sensor->unaltered = memcmp(sensor->counts, counts, sizeof sensor->counts) == 0;
    memcpy(sensor->counts, counts, sizeof sensor->counts);
    sensor->awaiting = false;
    bool alive = sensor->unchanged == 0 || sensor->state == SENSOR_OK; // a chip whose clock stopped stays failed
    if (is_settled(sensor) && alive) {
        sensor->has_sample = sensor->fresh = sensor->unsent = true;
        sensor->state = SENSOR_OK;
        sensor->failures = 0;
    }
    sensor->discard_next = false;
    if ((uint32_t)now_us - sensor->chore_us >= SENSOR_CHORE_INTERVAL_US) {
        sensor->chore_us = (uint32_t)now_us;
        sensor->phase = PHASE_CHORE;
    }
    sensor_schedule(sensor, link, now_us);
}

// If READY is set right after the data were read, reading does not clear it. Counted in a row, because a single READY
// may belong to a new conversion.
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
    uint64_t changes_us = sensor->triggered_us + sensor_chip(sensor)->trigger->fastest_us;
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

// Triggers a chip that the board paces.
static enum bus_result start(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip_wires wires = sensor_wires(sensor, link);
    const struct chip_trigger *trigger = sensor_chip(sensor)->trigger;
    enum bus_result result = chip_write(&wires, trigger->bytes, trigger->count);
    if (result != BUS_OK)
        return result;
    sensor->triggered_us = clock_now(link->clock);
    sensor->awaiting = true;
    sensor_schedule(sensor, link, sensor->triggered_us);
    return BUS_OK;
}

static enum bus_result set(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip_wires wires = sensor_wires(sensor, link);
    enum bus_result result = sensor_chip(sensor)->set(&wires);
    if (result != BUS_OK)
        return result;
    uint64_t now_us = clock_now(link->clock);
    sensor_was_set(sensor, now_us);
    sensor_schedule(sensor, link, now_us);
    return BUS_OK;
}

static enum bus_result accept_of_film(struct sensor *sensor, const struct sensor_link *link, int16_t counts[3])
{
    bool due = is_settled(sensor) && sensor_film_needs_set(sensor, counts, (uint32_t)clock_now(link->clock));
    accept(sensor, link, counts);
    if (due)
        return set(sensor, link);
    return link->trigger == TRIGGER_FREE ? start(sensor, link) : BUS_OK;
}

enum bus_result sensor_poll(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip *chip = sensor_chip(sensor);
    struct chip_sample sample = {.temperature_raw = WIRE_TEMPERATURE_UNKNOWN};
    if (sensor->overtaken)
        return read_overtaken(sensor, link);
    if (chip->paced && link->trigger == TRIGGER_FREE && !sensor->awaiting)
        return start(sensor, link);
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
        result = read_counts(sensor, link, sample.counts); // also undoes LOCK, if only LOCK is set
    if (result != BUS_OK || !ready)
        return result;
    if (sample.temperature_raw != WIRE_TEMPERATURE_UNKNOWN)
        sensor->temperature_raw = sample.temperature_raw;
    if (sensor_streams(sensor, link->trigger)) {
        if (!is_new(sensor, sample.counts, seen_us)) {
            sensor->due_us = seen_us + POLL_PAUSE_US;
            return BUS_OK;
        }
        conversion_seen(&sensor->conversion, seen_us);
    } else {
        sensor->conversion.ended_us = sensor->triggered_us + chip->trigger->conversion_us;
    }
    if (chip->set)
        return accept_of_film(sensor, link, sample.counts);
    accept(sensor, link, sample.counts);
    if (sensor->unchanged >= UNCHANGED_MAX)
        sensor_fail(sensor, SENSOR_NO_NEW_DATA, seen_us);
    return sensor->phase == PHASE_CHORE && chip->ready_unsure ? probe_ready(sensor, link) : BUS_OK;
}
