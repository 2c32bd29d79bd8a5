// The board as the host sees it: announces itself, answers requests, streams frames, reports its state.
#ifndef FMFTS_DEVICE_H
#define FMFTS_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bus.h"
#include "load_cell.h"
#include "pads.h"
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

// What the target tells the core. It must outlive the device.
struct board {
    const struct bus *buses;
    uint8_t bus_count;
    const uint8_t *i2c_ports; // for each bus, the port number in the hello
    struct pads *pads; // the pads, which a host may request anew
    const struct load_cell_pins *load_cell; // NULL: no pins for a load cell
    uint8_t uid[WIRE_UID_SIZE];
    uint8_t reset_cause;
    uint8_t clock_source;
    uint32_t (*now_us)(void *context);
    // Takes the whole line, or none of it and returns false. Never waits.
    bool (*send)(void *context, const uint8_t *line, size_t count);
    void *context;
};

struct device {
    const struct board *board;
    struct clock clock;
    struct sampler sampler;
    struct selftest selftest;
    struct wire_decoder decoder;
    struct wire_selftest_sensor results[SAMPLER_SENSORS_MAX]; // in the order of the sampler's sensors
    uint32_t transmit_dropped;
    uint32_t receive_errors;
    uint32_t load_sequence;
    uint64_t status_us; // when the next status is due; before the first status, when the hello is due
    uint64_t reported_states; // sensor states in the last status, four bits a sensor
    uint64_t reported_us;
    uint64_t selftest_us; // when the last self-test ended
    uint16_t wanted_pads; // as in `struct pads`, until the reply has been sent; else 0
    uint8_t selftest_id;
    uint8_t selftest_pads;    // bit i: request selftest_id asked for pad i
    uint8_t selftest_waiting; // bit i: pad i was asked and has no result yet
    bool announced;
    bool running;
};

void device_init(struct device *device, const struct board *board);

// Takes bytes from the host, in pieces of any size, and answers the requests in them.
void device_receive(struct device *device, const uint8_t *bytes, size_t count);

// Performs what is due next: at most a few short transfers. False: nothing was due.
bool device_poll(struct device *device);

#endif
