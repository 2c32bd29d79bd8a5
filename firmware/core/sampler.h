// Polls the sensors of up to three pads on one or two buses, by turns, and makes frames. Never waits; call it in a
// loop.
#ifndef FMFTS_SAMPLER_H
#define FMFTS_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "pad_bus.h"
#include "wire.h"

enum { RATE_MAX_HZ = 220 }; // rate of frames: the HMC5983's own

void sampler_init(struct sampler *sampler, struct clock *clock, const struct bus *buses, uint8_t bus_count,
                  const struct pad_wiring *pads, uint8_t pad_count);

// Takes effect at once. A new gain or trigger configures every sensor anew; until a sensor has settled, frames have no
// sample of it.
void sampler_apply(struct sampler *sampler, const struct sampler_settings *settings);

// With simultaneous triggers it is the rate that the detected chips allow; it falls if a slower chip is found later.
uint16_t sampler_rate_max(const struct sampler *sampler, enum trigger trigger);

void sampler_stream(struct sampler *sampler, bool streaming);

// Does what is due next, at most one sensor's turn. False: nothing was due.
bool sampler_poll(struct sampler *sampler);

// Fills `early` with the sample that the last sampler_poll read, if its pad sends it early. False: there is no such
// sample.
bool sampler_take_early(struct sampler *sampler, struct wire_early *early);

// Fills `frame` with a finished frame of any pad. False: there is no such frame.
bool sampler_take(struct sampler *sampler, struct wire_sample *frame);

#endif
