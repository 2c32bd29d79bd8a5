// The whole emulated board: bench, pads, chips, and the firmware core that runs on them.
#ifndef FMFTS_HOST_EMULATION_H
#define FMFTS_HOST_EMULATION_H

#include "../core/device.h"
#include "../emulated/bench.h"
#include "../emulated/converter.h"

struct emulation {
    struct bench bench;
    struct emulated_chip chips[SAMPLER_PADS_MAX][PAD_SENSORS_MAX];
    uint8_t chip_count[SAMPLER_PADS_MAX]; // chips on the channels of each switch, from 0 on
    uint8_t switch_count;
    struct emulated_switch *switches[SAMPLER_PADS_MAX];
    struct pads pads; // data that a board keeps over a reset
    struct emulated_converter converter;
    struct board board;
    struct device device;
    uint64_t frames_before_reset[SAMPLER_PADS_MAX];
    bool (*send)(void *line_context, const uint8_t *line, size_t count);
    void *line_context;
};

// Pads 0 and 1 share bus 0 behind two muxes, pad 2 is alone on bus 1; each has four chips. Each chip's clock has its own error, as in
// reality. `send` takes a whole line, or none of it and returns false.
void emulation_init(struct emulation *emulation, uint8_t pad_count, const uint8_t uid[WIRE_UID_SIZE],
                    bool (*send)(void *line_context, const uint8_t *line, size_t count), void *line_context);

// Gives the first switch chips on all its channels, and resets the MCU as at power-on: it finds two pads there, and a
// host may merge them into one. At most one other switch may be there.
void emulation_fill_switch(struct emulation *emulation);

// Resets the MCU: the core and its clock start again from zero; the chips keep their registers.
void emulation_reset(struct emulation *emulation);

// Resets the board through its pin: it searches its pads anew, and forgets how many sensors a host wanted in each.
void emulation_reset_by_pin(struct emulation *emulation);

// Runs the board up to this virtual time.
void emulation_run_until(struct emulation *emulation, uint64_t virtual_ns);

// Moves the clock forward without running the core; only its 64-bit clock is kept up to date.
void emulation_jump(struct emulation *emulation, uint64_t us);

// Makes every chip finish its conversions up to now, so that a change of the field does not affect past conversions.
void emulation_settle(struct emulation *emulation);

#endif
