// The two pins set aside for an HX711.
#ifndef FMFTS_LOAD_CELL_PINS_H
#define FMFTS_LOAD_CELL_PINS_H

#include "../core/load_cell.h"

// Port A must be clocked, and the timer run.
const struct load_cell_pins *load_cell_pins_start(void);

#endif
