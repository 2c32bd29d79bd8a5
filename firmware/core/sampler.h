// Takes turns on the buses and makes frames: up to three pads on one or two buses. Never waits; poll it in a loop.
#ifndef FMFTS_SAMPLER_H
#define FMFTS_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "sensor.h"
#include "tca9548a.h"
#include "wire.h"

enum {
    SAMPLER_PADS_MAX = WIRE_PADS_MAX,
    SAMPLER_BUSES_MAX = 2,
    SAMPLER_SENSORS_MAX = 4,
    // 6.2 ms of conversion, then one sensor asked and the trigger, 107 bits with their selects: 6.47 ms, and some for the
    // processor's own time.
    SINGLE_RATE_MAX_HZ = 152,
};

struct pad_wiring {
    uint8_t bus; // index into the board's buses
    uint8_t mux_address;
    uint8_t sensor_count;
    uint8_t channels[SAMPLER_SENSORS_MAX];
};

struct sampler_settings {
    uint16_t rate_hz;
    uint8_t gain_code;
    uint8_t trigger; // enum trigger
};

struct sampler_pad {
    struct pad_wiring wiring;
    struct sensor sensors[SAMPLER_SENSORS_MAX];
    uint32_t bus_errors;
    uint32_t config_repairs;
    uint32_t sequence;
    uint64_t last_time_us;
    uint8_t mux_strikes;
    bool borrowed; // by the self-test
    bool trigger_due;
    bool converting; // triggered, not all sensors read yet
    bool ahead;      // triggered anew, while samples of the last trigger may still be unread
    bool frame_due;
    uint8_t triggered; // bit i: by the last trigger, sensor i
    uint8_t confirm_next;
    uint64_t triggered_us;
};

struct sampler_bus {
    struct route route;
    uint32_t recoveries;
    uint64_t retry_us;
};

struct sampler {
    struct clock *clock;
    struct sampler_settings settings;
    bool streaming; // frames are made; sensors are looked after whether or not
    uint8_t pad_count;
    uint8_t turn;
    uint32_t frame_remainder;
    uint64_t frame_us; // when the next frame is due
    struct sampler_pad pads[SAMPLER_PADS_MAX];
    struct sampler_bus buses[SAMPLER_BUSES_MAX];
};

void sampler_init(struct sampler *sampler, struct clock *clock, const struct bus *buses, uint8_t bus_count,
                  const struct pad_wiring *pads, uint8_t pad_count);

// Takes effect at once; every sensor is configured anew and frames hold no samples until it has settled.
void sampler_apply(struct sampler *sampler, const struct sampler_settings *settings);

uint16_t sampler_rate_max(enum trigger trigger);

void sampler_stream(struct sampler *sampler, bool streaming);

// Does what is due next, at most one sensor's turn. False: nothing was due.
bool sampler_poll(struct sampler *sampler);

// Takes a finished frame of any pad. False: there is none.
bool sampler_take(struct sampler *sampler, struct wire_sample *frame);

// For the self-test and simultaneous triggers: reach these channels of a pad, and keep the books on what happened there. `sensor` may be NULL.
enum bus_result sampler_reach(struct sampler *sampler, struct sampler_pad *pad, uint8_t channels);
bool sampler_reach_for(struct sampler *sampler, struct sampler_pad *pad, int sensor);
struct sensor_link sampler_link(struct sampler *sampler, struct sampler_pad *pad);
void sampler_account(struct sampler *sampler, struct sampler_pad *pad, struct sensor *sensor, enum bus_result result);

#endif
