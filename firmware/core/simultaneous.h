// Triggers all sensors of a pad at once, and decides when the next trigger may come.
#ifndef FMFTS_SIMULTANEOUS_H
#define FMFTS_SIMULTANEOUS_H

#include <stdbool.h>
#include <stdint.h>

#include "pad_bus.h"

// Triggers a pad, or does what must precede that. False: nothing was due. At rates near the chips' limit it
// triggers again as soon as the conversions have ended; the samples are read while the chips convert the next ones.
bool simultaneous_poll(struct sampler *sampler, uint64_t now_us);

// Drops the pad's running conversions, because settings changed or the self-test starts.
void simultaneous_forget(struct sampler_pad *pad);

#endif
