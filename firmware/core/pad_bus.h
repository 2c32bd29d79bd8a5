// The pads and their buses: opening the way to a sensor, counting errors, and recovering a bus. The sampler, the
// simultaneous trigger and the self-test share this file.
#ifndef FMFTS_PAD_BUS_H
#define FMFTS_PAD_BUS_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "pads.h"
#include "sensor.h"
#include "tca9548a.h"
#include "wire.h"

enum {
    SAMPLER_PADS_MAX = WIRE_PADS_MAX,
    SAMPLER_BUSES_MAX = 2,
    SAMPLER_SENSORS_MAX = PADS_SENSORS_MAX,
};

struct sampler_settings {
    uint16_t rate_hz;
    uint8_t gain_code;
    uint8_t trigger; // enum trigger
};

struct sampler_pad {
    struct pad_wiring wiring;
    struct sensor *sensors; // the pad's part of the sampler's sensors
    uint32_t bus_errors;
    uint32_t config_repairs;
    uint32_t sequence;
    uint64_t last_time_us;
    uint8_t mux_strikes;
    bool borrowed; // the self-test uses the pad
    bool trigger_due;
    bool converting; // the sensors were triggered, and some are not read yet
    bool ahead;      // triggered again, while samples of the previous trigger may still be unread
    bool frame_due;
    uint8_t triggered; // bit i: the last trigger reached sensor i
    uint8_t confirmed_last; // the sensor that simultaneous.c asked most recently
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
    bool streaming; // whether the board makes frames; it polls sensors in any case
    uint8_t early;  // bit i: samples of pad i are also sent singly, before their frames; only while chips run free
    uint8_t pad_count;
    uint8_t sensor_count; // of all pads
    uint8_t turn;         // the sensor, among all, that had the last turn
    uint32_t frame_remainder;
    uint64_t frame_us; // when the next frame is due
    struct sampler_pad pads[SAMPLER_PADS_MAX];
    struct sensor sensors[SAMPLER_SENSORS_MAX]; // the sensors of pad 0, then those of pad 1, ...
    struct sampler_bus buses[SAMPLER_BUSES_MAX];
};

// Opens exactly these mux channels of the pad. A mux that stays silent three times in a row fails the pad's sensors.
enum bus_result pad_bus_reach(struct sampler *sampler, struct sampler_pad *pad, uint8_t channels);

// The mux channel of sensor `i` as a bit; 0 without a mux.
uint8_t pad_bus_channel(const struct pad_wiring *wiring, int i);

// Opens the channel of sensor `i`. On failure it counts the error, postpones the sensor, and returns false.
bool pad_bus_reach_sensor(struct sampler *sampler, struct sampler_pad *pad, int i);

struct sensor_link pad_bus_link(struct sampler *sampler, struct sampler_pad *pad);

// Counts a failed transfer and recovers the bus if needed. `sensor` gets a strike; it may be NULL.
void pad_bus_account(struct sampler *sampler, struct sampler_pad *pad, struct sensor *sensor, enum bus_result result);

#endif
