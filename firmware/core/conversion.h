// When a chip that converts by its own clock finished a conversion, from what polls of its READY bit showed.
#ifndef FMFTS_CONVERSION_H
#define FMFTS_CONVERSION_H

#include <stdint.h>

struct conversion {
    uint64_t ended_us;     // end of the last conversion, estimated
    uint64_t not_ready_us; // last time that READY was seen clear
    uint64_t ready_us;     // last time that it was seen set
    uint16_t period_us;    // of this chip's clock, learned
};

void conversion_restart(struct conversion *conversion, uint64_t now_us);

// READY was seen set, and the data were new.
void conversion_seen(struct conversion *conversion, uint64_t seen_us);

// When to look for the next one.
uint64_t conversion_next_poll_us(const struct conversion *conversion);

#endif
