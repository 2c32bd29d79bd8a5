// The two pins for an HX711.
#ifndef FMFTS_RP2040_LOAD_CELL_PINS_H
#define FMFTS_RP2040_LOAD_CELL_PINS_H

#include "../core/load_cell.h"

// The banks of pins must be out of reset, and the timer must run.
const struct load_cell_pins *load_cell_pins_start(void);

#endif
