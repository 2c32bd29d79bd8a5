// One trigger to all sensors of a pad at once: when the next one may come, and what it leaves unread.
#ifndef FMFTS_SIMULTANEOUS_H
#define FMFTS_SIMULTANEOUS_H

#include <stdbool.h>
#include <stdint.h>

#include "pad_bus.h"

// Triggers a pad, or does what has to come before. False: nothing was due. At rates near the chips' limit the next trigger
// is sent as soon as the conversions have ended, and the samples are read while the next ones are made.
bool simultaneous_poll(struct sampler *sampler, uint64_t now_us);

// The pad's conversions are of no use any more: other settings, or the self-test.
void simultaneous_forget(struct sampler_pad *pad);

#endif
