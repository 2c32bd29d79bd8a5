// The pads of a board as they were found, and how many sensors a host wants in each.
#ifndef FMFTS_PADS_H
#define FMFTS_PADS_H

#include <stdbool.h>
#include <stdint.h>

#include "wire.h"

enum {
    PAD_SENSORS_FOUND = 4, // sensors of a pad that the board finds: half the channels of a mux
    PAD_SENSORS_MAX = WIRE_SENSORS_MAX,
    PADS_SENSORS_MAX = WIRE_PADS_MAX * PAD_SENSORS_FOUND, // of all pads together
};

struct pad_wiring {
    uint8_t bus; // index into the board's buses
    uint8_t mux_address; // or TCA9548A_NONE
    uint8_t sensor_count;
    uint8_t first; // channel of the first sensor (without a mux: its own address); the others follow it
};

// A target keeps them in memory that survives a reset.
struct pads {
    uint8_t count;
    struct pad_wiring found[WIRE_PADS_MAX]; // of PAD_SENSORS_FOUND each
    uint16_t wanted; // sensors of pad 0 in the lowest four bits, of pad 1 in the next, ...; 0: PAD_SENSORS_FOUND
    uint16_t crc;
};

void pads_seal(struct pads *pads);

// Whether they are unchanged since they were sealed.
bool pads_are_whole(const struct pads *pads);

// Makes the pads with this many sensors each, and returns the number of pads; 0: impossible. A pad of more than
// PAD_SENSORS_FOUND sensors occupies all channels of its mux.
uint8_t pads_make(const struct pads *pads, uint16_t wanted, struct pad_wiring wiring[WIRE_PADS_MAX]);

#endif
