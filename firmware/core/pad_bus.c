#include "pad_bus.h"

enum {
    MUX_STRIKES_MAX = 3,
    BUS_RETRY_US = 100000,
};

enum bus_result pad_bus_reach(struct sampler *sampler, struct sampler_pad *pad, uint8_t channels)
{
    enum bus_result result = route_open(&sampler->buses[pad->wiring.bus].route, pad->wiring.mux_address, channels);
    if (result == BUS_OK) {
        pad->mux_strikes = 0;
    } else if (result == BUS_NO_ANSWER && ++pad->mux_strikes >= MUX_STRIKES_MAX) {
        pad->mux_strikes = 0;
        for (int i = 0; i < pad->wiring.sensor_count; i++)
            sensor_fail(&pad->sensors[i], SENSOR_MUX_NO_ANSWER, clock_now(sampler->clock));
    }
    return result;
}

static void recover(struct sampler *sampler, uint8_t bus_index)
{
    struct sampler_bus *bus = &sampler->buses[bus_index];
    enum bus_result result = bus->route.bus->recover(bus->route.bus->context);
    uint64_t now_us = clock_now(sampler->clock);
    bus->recoveries++;
    bus->route.known = false; // recovery may have pulled the switches' RESET
    if (result == BUS_OK)
        return;
    bus->retry_us = now_us + BUS_RETRY_US;
    for (int p = 0; p < sampler->pad_count; p++)
        for (int i = 0; i < sampler->pads[p].wiring.sensor_count && sampler->pads[p].wiring.bus == bus_index; i++)
            sensor_fail(&sampler->pads[p].sensors[i], SENSOR_BUS_STUCK, now_us);
}

void pad_bus_account(struct sampler *sampler, struct sampler_pad *pad, struct sensor *sensor, enum bus_result result)
{
    if (result == BUS_OK)
        return;
    pad->bus_errors++;
    if (sensor)
        sensor_strike(sensor, clock_now(sampler->clock));
    if (result != BUS_NO_ANSWER)
        recover(sampler, pad->wiring.bus);
}

uint8_t pad_bus_channel(const struct pad_wiring *wiring, int i)
{
    return (uint8_t)(wiring->mux_address == TCA9548A_NONE ? 0 : 1 << (wiring->first + i));
}

struct sensor_link pad_bus_link(struct sampler *sampler, struct sampler_pad *pad)
{
    return (struct sensor_link){
        .bus = sampler->buses[pad->wiring.bus].route.bus,
        .clock = sampler->clock,
        .config_repairs = &pad->config_repairs,
        .rate_hz = sampler->settings.rate_hz,
        .gain_code = sampler->settings.gain_code,
        .trigger = sampler->settings.trigger,
    };
}

bool pad_bus_reach_sensor(struct sampler *sampler, struct sampler_pad *pad, int i)
{
    enum bus_result result = pad_bus_reach(sampler, pad, pad_bus_channel(&pad->wiring, i));
    if (result == BUS_OK)
        return true;
    // The mux failed, not the sensor: the sensor waits 1 ms but gets no strike.
    uint64_t now_us = clock_now(sampler->clock);
    if (pad->sensors[i].due_us <= now_us)
        pad->sensors[i].due_us = now_us + 1000;
    pad_bus_account(sampler, pad, NULL, result);
    return false;
}
