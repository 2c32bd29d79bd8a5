// Polls the sensors of up to three pads on one or two buses, by turns, and makes frames. Never waits; call it in a
// loop.
#ifndef FMFTS_SAMPLER_H
#define FMFTS_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "pad_bus.h"
#include "wire.h"

enum {
    // One frame takes 6.47 ms: 6.2 ms of conversion, then one sensor's status and the trigger (107 bits with the mux
    // selects). The rest is for the processor.
    SINGLE_RATE_MAX_HZ = 152,
};

void sampler_init(struct sampler *sampler, struct clock *clock, const struct bus *buses, uint8_t bus_count,
                  const struct pad_wiring *pads, uint8_t pad_count);

// Takes effect at once. A new gain or trigger configures every sensor anew; frames have no sample of it until it
// settled.
void sampler_apply(struct sampler *sampler, const struct sampler_settings *settings);

uint16_t sampler_rate_max(enum trigger trigger);

void sampler_stream(struct sampler *sampler, bool streaming);

// Does what is due next, at most one sensor's turn. False: nothing was due.
bool sampler_poll(struct sampler *sampler);

// Fills `early` with the sample that the last sampler_poll read, if its pad sends it early. False: there is none.
bool sampler_take_early(struct sampler *sampler, struct wire_early *early);

// Fills `frame` with a finished frame of any pad. False: there is none.
bool sampler_take(struct sampler *sampler, struct wire_sample *frame);

#endif
