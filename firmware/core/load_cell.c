#include "load_cell.h"

enum { DATA_BITS = 24 };

static bool clock_bit(const struct load_cell_pins *pins)
{
    pins->set_clock(pins->context, true);
    bool bit = pins->data_is_high(pins->context);
    pins->set_clock(pins->context, false);
    return bit;
}

bool load_cell_read(const struct load_cell_pins *pins, int32_t *counts)
{
    if (pins->data_is_high(pins->context))
        return false;
    uint32_t bits = 0;
    for (int i = 0; i < DATA_BITS; i++)
        bits = bits << 1 | clock_bit(pins);
    // The 25th pulse selects channel A with gain 128, and the chip holds DOUT high until the next conversion ends. A
    // line that stays low is a short circuit.
    if (!clock_bit(pins))
        return false;
    *counts = (int32_t)(bits << 8) >> 8;
    return true;
}
