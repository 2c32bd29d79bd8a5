// Takes turns on the buses and makes frames: up to three pads on one or two buses. Never waits; poll it in a loop.
#ifndef FMFTS_SAMPLER_H
#define FMFTS_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "pad_bus.h"
#include "wire.h"

enum {
    RATE_MAX_HZ = 220,
    // 6.2 ms of conversion, then one sensor asked and the trigger, 107 bits with their selects: 6.47 ms, and some for the
    // processor's own time.
    SINGLE_RATE_MAX_HZ = 152,
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

#endif
