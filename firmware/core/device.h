// The board as the host sees it: answers requests, announces itself, streams frames, reports its state.
#ifndef FMFTS_DEVICE_H
#define FMFTS_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bus.h"
#include "load_cell.h"
#include "sampler.h"
#include "selftest.h"
#include "wire.h"

enum { FIRMWARE_MAJOR = 0, FIRMWARE_MINOR = 1, FIRMWARE_PATCH = 0 };

enum reset_cause {
    RESET_UNKNOWN,
    RESET_POWER_ON,
    RESET_PIN,
    RESET_SOFTWARE,
    RESET_INDEPENDENT_WATCHDOG,
    RESET_WINDOW_WATCHDOG,
    RESET_LOW_POWER,
};

enum clock_source { CLOCK_HOST, CLOCK_HSE, CLOCK_HSI };

// What the target knows and the core does not. It must outlive the device.
struct board {
    const struct bus *buses;
    uint8_t bus_count;
    const uint8_t *i2c_ports; // per bus, the number that the hello carries
    const struct pad_wiring *pads;
    uint8_t pad_count;
    const struct load_cell_pins *load_cell; // NULL where no pins are set aside for one
    uint8_t uid[WIRE_UID_SIZE];
    uint8_t reset_cause;
    uint8_t clock_source;
    uint32_t (*now_us)(void *context);
    // Takes the whole line or none of it, at once.
    bool (*send)(void *context, const uint8_t *line, size_t count);
    void *context;
};

struct device {
    const struct board *board;
    struct clock clock;
    struct sampler sampler;
    struct selftest selftest;
    struct wire_decoder decoder;
    struct wire_selftest_sensor results[SAMPLER_PADS_MAX][SAMPLER_SENSORS_MAX];
    uint32_t transmit_dropped;
    uint32_t receive_errors;
    uint32_t load_sequence;
    uint64_t status_us; // when the next status is due
    uint64_t reported_states; // what the last status said, four bits a sensor
    uint64_t reported_us;
    uint64_t selftest_us; // when the last self-test ended
    uint8_t selftest_id;
    uint8_t selftest_pads;    // bit i: pad i was asked for under selftest_id
    uint8_t selftest_waiting; // bit i: pad i has no result yet
    bool announced;
    bool running;
};

void device_init(struct device *device, const struct board *board);

// Bytes from the host, in any portions.
void device_receive(struct device *device, const uint8_t *bytes, size_t count);

// Does what is due next, a few short transfers at most. False: nothing was due.
bool device_poll(struct device *device);

#endif
