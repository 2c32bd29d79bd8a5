// Which pads this board has: looked for at power-on, remembered over resets that nobody asked for.
#ifndef FMFTS_PADS_H
#define FMFTS_PADS_H

#include <stdbool.h>
#include <stdint.h>

#include "../core/bus.h"
#include "../core/pad_bus.h"

struct pads {
    uint8_t count;
    struct pad_wiring wiring[SAMPLER_PADS_MAX];
    uint16_t crc;
};

// Every TCA9548A is a pad on channels 0 to 3, a second one on channels 4 to 7 where a sensor answers there. The order is
// port, address, channel. `usable[i]` is false for a bus whose lines are stuck. Where nothing is found, one pad is taken
// for granted, so that the host is told what is missing.
//
// After the reset of a watchdog a switch may be silent for a moment; then every later pad would move up, and the host
// would take one pad's readings for another's. So `remembered` pads are kept.
const struct pads *pads_find(const struct bus *buses, const bool *usable, uint8_t bus_count, bool remembered);

#endif
