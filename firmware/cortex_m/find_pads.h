// Finds the pads of this board at power-on, and remembers them over unrequested resets.
#ifndef FMFTS_FIND_PADS_H
#define FMFTS_FIND_PADS_H

#include <stdbool.h>
#include <stdint.h>

#include "../core/bus.h"
#include "../core/pads.h"

// Every TCA9548A is a pad on channels 0 to 3, and a second pad on channels 4 to 7 if a sensor answers there. Four
// MLX90393 on a port itself are a pad without a switch, if two of them answer. Pads are ordered by port, address and
// channel; after them come a port's pads without a switch. `usable[i]` is false for a bus whose lines are stuck.
// If nothing is found, one pad is assumed, so that the board can report what is missing.
//
// If `remembered`, the pads found before the reset are kept, and how many sensors of each the host wanted.
// After a watchdog reset a mux may not answer for a moment; a new search would then miss a pad, and the host would
// assign the next pad's readings to it.
struct pads *find_pads(const struct bus *buses, const bool *usable, uint8_t bus_count, bool remembered);

#endif
