// The whole emulated board: bench, pads, chips, and the firmware core that runs on them.
#ifndef FMFTS_HOST_EMULATION_H
#define FMFTS_HOST_EMULATION_H

#include "../core/device.h"
#include "../emulated/bench.h"
#include "../emulated/converter.h"

struct emulation {
    struct bench bench;
    struct emulated_chip chips[SAMPLER_PADS_MAX][SAMPLER_SENSORS_MAX];
    struct emulated_switch *switches[SAMPLER_PADS_MAX];
    struct pad_wiring wiring[SAMPLER_PADS_MAX];
    struct emulated_converter converter;
    struct board board;
    struct device device;
    uint64_t frames_before_reset[SAMPLER_PADS_MAX];
    bool (*send)(void *line_context, const uint8_t *line, size_t count);
    void *line_context;
};

// Pad 0 and pad 1 share bus 0 behind two switches, pad 2 is alone on bus 1. Chip clocks differ as real ones do.
// `send` takes a whole line or none of it.
void emulation_init(struct emulation *emulation, uint8_t pad_count, const uint8_t uid[WIRE_UID_SIZE],
                    bool (*send)(void *line_context, const uint8_t *line, size_t count), void *line_context);

// What a reset of the MCU does: the core starts anew and its clock at zero; the chips keep what they hold.
void emulation_reset(struct emulation *emulation);

// Runs the board up to this virtual time.
void emulation_run_until(struct emulation *emulation, uint64_t virtual_ns);

// Moves the clock without letting the core run, but for what keeps its 64-bit time.
void emulation_jump(struct emulation *emulation, uint64_t us);

// Brings every chip up to now, so that what changes next does not reach conversions that are over.
void emulation_settle(struct emulation *emulation);

#endif
