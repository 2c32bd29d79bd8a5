// Estimates when a free-running chip finished its last conversion, from polls of its READY bit.
#ifndef FMFTS_CONVERSION_H
#define FMFTS_CONVERSION_H

#include <stdint.h>

struct conversion {
    uint64_t ended_us;     // end of the last conversion, estimated
    uint64_t not_ready_us; // when a poll last found READY clear
    uint64_t ready_us;     // when a poll last found READY set
    uint16_t nominal_us;   // its period by the data sheet
    uint16_t period_us;    // conversion period of this chip, learned
};

// The chip was set up: it converts about every `nominal_us`. What was learned about the same chip before is kept.
void conversion_restart(struct conversion *conversion, uint16_t nominal_us, uint64_t now_us);

// A poll at `seen_us` found READY set and new data.
void conversion_seen(struct conversion *conversion, uint64_t seen_us);

// When to poll for the next conversion.
uint64_t conversion_next_poll_us(const struct conversion *conversion);

#endif
