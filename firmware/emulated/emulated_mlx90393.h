// An MLX90393: commands in place of registers.
// emulated_mlx90393.c names the sources.
#ifndef FMFTS_EMULATED_MLX90393_H
#define FMFTS_EMULATED_MLX90393_H

#include "magnetometer.h"

enum { MLX90393_WORDS = 64 };

struct emulated_mlx90393 {
    struct emulated_magnetometer common;
    uint16_t words[MLX90393_WORDS]; // the customer area, as it is in use
    uint8_t mode, axes;             // mode of the status byte; the measured axes: bits z, y, x, t
    bool was_reset;
    double slowness; // factor by which a conversion takes longer than in the table; a test may set it
    bool acknowledged; // the status of an SM or SB was read since the reset
    bool start_unread; // the newest command returned such a status, and nobody has read it yet
    bool exits;                     // the mode ends at exits_ns
    uint64_t exits_ns;
    bool has_sample;
    uint8_t sample[8];
    uint8_t command[4], command_count;
    uint8_t answer[9], answer_count, answer_sent;
};

void emulated_mlx90393_init(struct emulated_mlx90393 *chip, uint8_t address, uint32_t seed);

#endif
