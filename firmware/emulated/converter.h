// An HX711 on a bench: 80 conversions a second, read bit by bit, in virtual time.
#ifndef FMFTS_EMULATED_CONVERTER_H
#define FMFTS_EMULATED_CONVERTER_H

#include <stdbool.h>
#include <stdint.h>

#include "../core/load_cell.h"
#include "bench.h"

struct emulated_converter {
    struct bench *bench;
    struct load_cell_pins pins;
    bool present;
    int32_t counts; // the load cell's present reading
    uint32_t shifted;
    int pulses; // clock pulses since the present read-out began
    bool clock, bit;
    uint64_t rose_ns, ready_ns;
};

// The converter is not plugged in (`present` is false).
void emulated_converter_init(struct emulated_converter *converter, struct bench *bench);

#endif
