// The two pins for an HX711.
#ifndef FMFTS_LOAD_CELL_PINS_H
#define FMFTS_LOAD_CELL_PINS_H

#include "../core/load_cell.h"

// Port A's clock and the timer must be on.
const struct load_cell_pins *load_cell_pins_start(void);

#endif
