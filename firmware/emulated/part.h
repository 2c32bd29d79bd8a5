// A chip on a channel of a switch, whatever its kind. Its kind's struct begins with this one.
#ifndef FMFTS_EMULATED_PART_H
#define FMFTS_EMULATED_PART_H

#include <stdbool.h>
#include <stdint.h>

struct emulated_part;

struct emulated_part_kind {
    void (*power_on)(struct emulated_part *part);
    void (*advance)(struct emulated_part *part, uint64_t now_ns); // does everything that is due by now
    // One transfer from the chip's side.
    void (*start_write)(struct emulated_part *part);
    void (*put)(struct emulated_part *part, uint8_t byte);
    uint8_t (*get)(struct emulated_part *part);
};

struct emulated_part {
    const struct emulated_part_kind *kind;
    uint8_t address;
    bool present;
};

#endif
