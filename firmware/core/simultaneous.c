#include "simultaneous.h"

static bool is_awaiting(const struct sampler_pad *pad)
{
    for (int i = 0; i < pad->wiring.sensor_count; i++)
        if (pad->sensors[i].awaiting)
            return true;
    return false;
}

// A trigger clears READY, but the sample stays in the output registers until the next conversion ends. So a sensor need
// not be read before the next trigger; its conversion must only have ended. There is time to ask one sensor per
// trigger, in turn; the same write started the others. Suspect sensors are always asked, then those with an equal
// sample.
static int sensor_to_confirm(const struct sampler_pad *pad)
{
    int count = pad->wiring.sensor_count, chosen = -1;
    bool confirmed = false;
    for (int n = count; n > 0; n--) {
        int i = (pad->confirmed_last + n) % count;
        const struct sensor *sensor = &pad->sensors[i];
        if (!sensor->awaiting)
            continue;
        if (sensor->suspect && !sensor->confirmed)
            return i;
        confirmed |= sensor->confirmed;
        if (chosen < 0 || !pad->sensors[chosen].unaltered || sensor->unaltered)
            chosen = i;
    }
    return confirmed ? -1 : chosen;
}

static void confirm(struct sampler *sampler, struct sampler_pad *pad, int i)
{
    const struct sensor_link link = pad_bus_link(sampler, pad);
    if (pad_bus_reach_sensor(sampler, pad, i))
        pad_bus_account(sampler, pad, &pad->sensors[i], sensor_confirm(&pad->sensors[i], &link));
    pad->confirmed_last = (uint8_t)i;
}

// The channels of all sensors that take the same trigger as sensor `first`; also marks these sensors in `done`.
static uint8_t alike(const struct sampler_pad *pad, int first, uint8_t *done)
{
    uint8_t channels = 0;
    for (int i = first; i < pad->wiring.sensor_count; i++) {
        if (!sensor_is_running(&pad->sensors[i]) || pad->sensors[i].place != pad->sensors[first].place)
            continue;
        channels |= pad_bus_channel(&pad->wiring, i);
        *done |= (uint8_t)(1 << i);
    }
    return channels;
}

// A mux passes a write to several channels at once, so all sensors of the pad start within one bit time. (Chips of
// another kind or address, which the host will reject, start one write later.)
static void trigger(struct sampler *sampler, struct sampler_pad *pad)
{
    enum bus_result result = BUS_OK;
    uint8_t done = 0;
    pad->triggered = 0;
    pad->trigger_due = false;
    pad->ahead = true;
    for (int i = 0; i < pad->wiring.sensor_count && result == BUS_OK; i++) {
        const struct sensor *sensor = &pad->sensors[i];
        if ((done >> i & 1) || !sensor_is_running(sensor))
            continue;
        const struct sensor_link link = pad_bus_link(sampler, pad);
        const struct chip_wires wires = sensor_wires(sensor, &link);
        const struct chip_trigger *single = sensor_chip(sensor)->trigger;
        result = pad_bus_reach(sampler, pad, alike(pad, i, &done));
        if (result == BUS_OK)
            result = chip_write(&wires, single->bytes, single->count);
        pad_bus_account(sampler, pad, NULL, result);
    }
    if (!done)
        return;
    pad->triggered = result == BUS_OK ? done : 0;
    pad->triggered_us = clock_now(sampler->clock);
    for (int i = 0; i < pad->wiring.sensor_count; i++)
        sensor_overtake(&pad->sensors[i], pad->triggered_us);
}

static void expect_samples(struct sampler_pad *pad)
{
    pad->ahead = false;
    pad->converting = true;
    for (int i = 0; i < pad->wiring.sensor_count; i++)
        if ((pad->triggered >> i & 1) && sensor_is_running(&pad->sensors[i]))
            sensor_await(&pad->sensors[i], pad->triggered_us);
}

// True if the running conversions may have ended, and another trigger would lose none of their samples.
static bool may_trigger(const struct sampler_pad *pad, uint64_t now_us)
{
    for (int i = 0; i < pad->wiring.sensor_count && pad->converting; i++) {
        const struct sensor *sensor = &pad->sensors[i];
        if (!sensor->awaiting)
            continue;
        const struct chip_trigger *single = sensor_chip(sensor)->trigger;
        if (!single->fastest_us || now_us < pad->triggered_us + single->wait_us)
            return false;
    }
    return true;
}

static bool poll_pad(struct sampler *sampler, struct sampler_pad *pad, uint64_t now_us)
{
    if (pad->converting && !is_awaiting(pad)) {
        pad->converting = false;
        pad->frame_due = true;
        return true;
    }
    if (pad->ahead) {
        if (!pad->converting && !pad->frame_due)
            expect_samples(pad);
        return false;
    }
    if (!pad->trigger_due || pad->frame_due || sampler->buses[pad->wiring.bus].retry_us > now_us)
        return false;
    if (!may_trigger(pad, now_us))
        return false;
    int unconfirmed = pad->converting ? sensor_to_confirm(pad) : -1;
    if (unconfirmed < 0)
        trigger(sampler, pad);
    else if (pad->sensors[unconfirmed].due_us <= now_us)
        confirm(sampler, pad, unconfirmed);
    else
        return false;
    return true;
}

bool simultaneous_poll(struct sampler *sampler, uint64_t now_us)
{
    for (int p = 0; p < sampler->pad_count; p++)
        if (!sampler->pads[p].borrowed && poll_pad(sampler, &sampler->pads[p], now_us))
            return true;
    return false;
}

void simultaneous_forget(struct sampler_pad *pad)
{
    pad->frame_due = pad->trigger_due = pad->converting = pad->ahead = false;
}
