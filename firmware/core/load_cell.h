// An HX711, the 24-bit converter of a load cell (Avia Semiconductor data sheet, "Serial Interface").
#ifndef FMFTS_LOAD_CELL_H
#define FMFTS_LOAD_CELL_H

#include <stdbool.h>
#include <stdint.h>

struct load_cell_pins {
    bool (*data_is_high)(void *context); // DOUT, pulled up: high where no chip is wired
    // PD_SCK: returns after the level has held for 0.2 µs. The chip powers down if it is high for 50 µs.
    void (*set_clock)(void *context, bool high);
    void *context;
};

// Reads a finished conversion, signed. False: no conversion is finished, or there is no chip.
bool load_cell_read(const struct load_cell_pins *pins, int32_t *counts);

#endif
