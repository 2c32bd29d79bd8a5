#include "sampler.h"

#include "simultaneous.h"

enum {
    CHORE_STAGGER_US = 11000,
    LATE_FRAME_US = 50000,
    // The turns of other sensors delay reading a conversion by up to this. With much more its time would be unknown.
    READ_LATENESS_US = 600,
    READ_US = 680, // one sensor's turn, including its part of the trigger and of the frame
};

void sampler_init(struct sampler *sampler, struct clock *clock, const struct bus *buses, uint8_t bus_count,
                  const struct pad_wiring *pads, uint8_t pad_count)
{
    uint64_t now_us = clock_now(clock);
    *sampler = (struct sampler){
        .clock = clock,
        .settings = {.rate_hz = RATE_MAX_HZ, .gain_code = 3, .trigger = TRIGGER_FREE},
        .pad_count = pad_count,
        .frame_us = now_us,
    };
    for (int bus = 0; bus < bus_count; bus++)
        route_init(&sampler->buses[bus].route, &buses[bus]);
    for (int p = 0; p < pad_count; p++) {
        struct sampler_pad *pad = &sampler->pads[p];
        pad->wiring = pads[p];
        pad->sensors = &sampler->sensors[sampler->sensor_count];
        bool has_mux = pad->wiring.mux_address != TCA9548A_NONE;
        if (has_mux)
            route_add_switch(&sampler->buses[pad->wiring.bus].route, pad->wiring.mux_address);
        for (int i = 0; i < pad->wiring.sensor_count; i++)
            sensor_init(&pad->sensors[i], has_mux ? SENSOR_ANY_ADDRESS : (uint8_t)(pad->wiring.first + i), now_us,
                        now_us + (uint64_t)(CHORE_STAGGER_US * sampler->sensor_count++));
    }
}

void sampler_apply(struct sampler *sampler, const struct sampler_settings *settings)
{
    uint64_t now_us = clock_now(sampler->clock);
    const struct sampler_settings before = sampler->settings;
    bool all = settings->gain_code != before.gain_code || settings->trigger != before.trigger;
    sampler->settings = *settings;
    sampler->frame_us = now_us;
    sampler->frame_remainder = 0;
    for (int p = 0; p < sampler->pad_count; p++) {
        struct sampler_pad *pad = &sampler->pads[p];
        if (all)
            simultaneous_forget(pad);
        for (int i = 0; i < pad->wiring.sensor_count; i++) {
            const struct chip *chip = sensor_chip(&pad->sensors[i]);
            bool other_speed = settings->trigger == TRIGGER_FREE &&
                               chip_speed_for(chip, settings->rate_hz) != chip_speed_for(chip, before.rate_hz);
            if (all || other_speed)
                sensor_reconfigure(&pad->sensors[i], now_us);
        }
    }
}

// Chips that keep a sample while they measure are read then; all others are read before the next trigger.
uint16_t sampler_rate_max(const struct sampler *sampler, enum trigger trigger)
{
    uint32_t rate_hz = RATE_MAX_HZ;
    for (int i = 0; i < sampler->sensor_count && trigger == TRIGGER_SIMULTANEOUS; i++) {
        const struct sensor *sensor = &sampler->sensors[i];
        const struct chip_trigger *single = sensor_chip(sensor)->trigger;
        if (!single || !sensor_is_identified(sensor))
            continue;
        uint32_t allowed_hz = single->rate_max_hz;
        uint32_t bus_hz = 1000000U / (single->wait_us + (uint32_t)READ_US * sampler->sensor_count);
        if (!single->fastest_us && bus_hz < allowed_hz)
            allowed_hz = bus_hz;
        rate_hz = allowed_hz < rate_hz ? allowed_hz : rate_hz;
    }
    return (uint16_t)rate_hz;
}

void sampler_stream(struct sampler *sampler, bool streaming)
{
    if (streaming && !sampler->streaming)
        sampler->frame_us = clock_now(sampler->clock);
    sampler->streaming = streaming;
}

static void turn(struct sampler *sampler, struct sampler_pad *pad, int i)
{
    struct sensor *sensor = &pad->sensors[i];
    bool held = true;
    enum bus_result result = BUS_OK;
    if (!pad_bus_reach_sensor(sampler, pad, i))
        return;
    if (sensor->phase == PHASE_CHORE)
        result = route_check(&sampler->buses[pad->wiring.bus].route, &held);
    if (result == BUS_OK && !held) {
        pad->bus_errors++;
        return;
    }
    const struct sensor_link link = pad_bus_link(sampler, pad);
    if (result == BUS_OK)
        result = sensor_turn(sensor, &link);
    pad_bus_account(sampler, pad, sensor, result);
}

static bool schedule_frames(struct sampler *sampler, uint64_t now_us)
{
    if (!sampler->streaming || now_us < sampler->frame_us)
        return false;
    uint32_t interval_us = 1000000U / sampler->settings.rate_hz;
    if (now_us > sampler->frame_us + interval_us + LATE_FRAME_US)
        sampler->frame_us = now_us; // frames missed in a pause are skipped
    // 1 s / 220 is no whole number of microseconds; carrying the remainder keeps the rate exact.
    sampler->frame_us += interval_us;
    sampler->frame_remainder += 1000000U % sampler->settings.rate_hz;
    if (sampler->frame_remainder >= sampler->settings.rate_hz) {
        sampler->frame_remainder -= sampler->settings.rate_hz;
        sampler->frame_us++;
    }
    for (int p = 0; p < sampler->pad_count; p++) {
        if (sampler->settings.trigger == TRIGGER_FREE)
            sampler->pads[p].frame_due = true;
        else
            sampler->pads[p].trigger_due = true;
    }
    return true;
}

// If a sample was read just too late for a frame, its successor would replace it before the next frame, and it would be
// lost. So the successor stays in the chip until that frame is made: no conversion of a chip slower than the frames is
// lost. A chip that is triggered after each read loses none.
static bool would_replace_unsent(const struct sampler *sampler, const struct sensor *sensor, uint64_t now_us)
{
    return sensor->fresh && sampler->streaming && sensor_streams(sensor, sampler->settings.trigger) &&
           sensor->phase == PHASE_RUN && now_us + READ_LATENESS_US > sampler->frame_us;
}

// The pad that has its turn; `i` gets the index of its sensor.
static struct sampler_pad *pad_in_turn(struct sampler *sampler, int *i)
{
    struct sampler_pad *pad = sampler->pads;
    for (*i = sampler->turn; *i >= pad->wiring.sensor_count; pad++)
        *i -= pad->wiring.sensor_count;
    return pad;
}

bool sampler_poll(struct sampler *sampler)
{
    uint64_t now_us = clock_now(sampler->clock);
    if (schedule_frames(sampler, now_us) || simultaneous_poll(sampler, now_us))
        return true;
    for (int n = 0, i; n < sampler->sensor_count; n++) {
        sampler->turn = (uint8_t)((sampler->turn + 1) % sampler->sensor_count);
        struct sampler_pad *pad = pad_in_turn(sampler, &i);
        if (pad->borrowed || pad->sensors[i].due_us > now_us || sampler->buses[pad->wiring.bus].retry_us > now_us ||
            would_replace_unsent(sampler, &pad->sensors[i], now_us))
            continue;
        turn(sampler, pad, i);
        return true;
    }
    return false;
}

static void fill(struct sampler *sampler, struct sampler_pad *pad, struct wire_sample *frame)
{
    uint64_t now_us = clock_now(sampler->clock), newest_us = 0;
    int temperature = 0, thermometers = 0;
    for (int i = 0; i < pad->wiring.sensor_count; i++) {
        struct sensor *sensor = &pad->sensors[i];
        frame->age_us[i] = WIRE_AGE_UNKNOWN;
        if (!sensor_is_valid(sensor, sampler->settings.trigger, now_us))
            continue;
        frame->valid |= (uint8_t)(1 << i);
        frame->fresh |= (uint8_t)(sensor->fresh << i);
        uint64_t time_us = sensor_time_us(sensor, sampler->settings.trigger);
        newest_us = time_us > newest_us ? time_us : newest_us;
        for (int axis = 0; axis < 3; axis++)
            frame->counts[i][axis] = sensor->counts[axis];
        if (sensor->temperature_raw != WIRE_TEMPERATURE_UNKNOWN) {
            temperature += sensor->temperature_raw;
            thermometers++;
        }
        sensor->fresh = false;
    }
    if (!frame->valid)
        newest_us = now_us;
    // The time of frames never goes back, even if the sensor with the newest sample was just lost.
    frame->time_us = newest_us > pad->last_time_us ? newest_us : pad->last_time_us;
    pad->last_time_us = frame->time_us;
    frame->temperature_raw = (int16_t)(thermometers ? temperature / thermometers : WIRE_TEMPERATURE_UNKNOWN);
    for (int i = 0; i < pad->wiring.sensor_count; i++) {
        if (!(frame->valid >> i & 1))
            continue;
        uint64_t age_us = frame->time_us - sensor_time_us(&pad->sensors[i], sampler->settings.trigger);
        if (age_us < WIRE_AGE_UNKNOWN)
            frame->age_us[i] = (uint16_t)age_us;
    }
}

bool sampler_take_early(struct sampler *sampler, struct wire_early *early)
{
    int i;
    const struct sampler_pad *pad = pad_in_turn(sampler, &i);
    long p = pad - sampler->pads;
    struct sensor *sensor = &pad->sensors[i];
    bool unsent = sensor->unsent;
    sensor->unsent = false;
    if (!unsent || !(sampler->early >> p & 1) || sampler->settings.trigger != TRIGGER_FREE)
        return false;
    early->place = WIRE_PLACE(p, i);
    early->gain_code = sampler->settings.gain_code;
    early->time_us = sensor_time_us(sensor, TRIGGER_FREE);
    early->counts = sensor->counts;
    return true;
}

bool sampler_take(struct sampler *sampler, struct wire_sample *frame)
{
    for (uint8_t p = 0; p < sampler->pad_count; p++) {
        struct sampler_pad *pad = &sampler->pads[p];
        if (!pad->frame_due)
            continue;
        pad->frame_due = false;
        if (pad->borrowed || !sampler->streaming)
            continue;
        *frame = (struct wire_sample){
            .pad_index = p,
            .sensor_count = pad->wiring.sensor_count,
            .sequence = pad->sequence++,
            .gain_code = sampler->settings.gain_code,
            .trigger = sampler->settings.trigger,
        };
        fill(sampler, pad, frame);
        return true;
    }
    return false;
}
