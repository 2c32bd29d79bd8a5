#include "converter.h"

enum {
    PERIOD_NS = 12500000, // RATE high: 80 a second
    EDGE_NS = 1000,
    POWER_DOWN_NS = 60000,
    PULSES = 25,
};

static bool data_is_high(void *context)
{
    const struct emulated_converter *converter = context;
    if (!converter->present)
        return true;
    return converter->pulses > 0 ? converter->bit : converter->bench->now_ns < converter->ready_ns;
}

static void shift(struct emulated_converter *converter)
{
    const struct bench *bench = converter->bench;
    if (converter->pulses == 0) {
        if (bench->now_ns < converter->ready_ns)
            return; // no conversion is ready: a pulse now would be lost
        converter->shifted = (uint32_t)converter->counts << 8;
    }
    converter->pulses++;
    converter->bit = converter->pulses == PULSES || converter->shifted >> 31;
    converter->shifted <<= 1;
    if (converter->pulses == PULSES) {
        uint64_t missed = (bench->now_ns - converter->ready_ns) / PERIOD_NS;
        converter->ready_ns += (missed + 1) * PERIOD_NS;
    }
}

static void set_clock(void *context, bool high)
{
    struct emulated_converter *converter = context;
    if (high && !converter->clock) {
        converter->rose_ns = converter->bench->now_ns;
        if (converter->present)
            shift(converter);
    }
    if (!high) {
        // If the clock is high for too long, the chip powers down, and starts again when the clock falls.
        if (converter->clock && converter->bench->now_ns - converter->rose_ns > POWER_DOWN_NS)
            converter->pulses = PULSES;
        if (converter->pulses == PULSES)
            converter->pulses = 0;
    }
    converter->clock = high;
    bench_pass_time(converter->bench, EDGE_NS);
}

void emulated_converter_init(struct emulated_converter *converter, struct bench *bench)
{
    *converter = (struct emulated_converter){.bench = bench, .ready_ns = PERIOD_NS};
    converter->pins = (struct load_cell_pins){data_is_high, set_clock, converter};
}
