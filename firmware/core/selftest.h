// The bias-strap self-test of one pad at a time. The sampler does not use that pad for about 0.2 s.
#ifndef FMFTS_SELFTEST_H
#define FMFTS_SELFTEST_H

#include <stdbool.h>
#include <stdint.h>

#include "pad_bus.h"

enum { SELFTEST_BIASES = 3 }; // none, positive, negative

struct selftest {
    struct sampler *sampler;
    bool active;
    uint8_t pad_index;
    uint8_t stage;
    uint8_t bias;
    uint8_t round;
    uint8_t sensor;
    uint8_t state[PAD_SENSORS_MAX];
    int16_t sums[PAD_SENSORS_MAX][SELFTEST_BIASES][3];
    uint64_t due_us;
};

void selftest_start(struct selftest *selftest, struct sampler *sampler, uint8_t pad_index);

// Does one step. True at the end: `results` holds the pad's result, and the sampler polls the pad again.
bool selftest_poll(struct selftest *selftest, struct wire_selftest_sensor results[PAD_SENSORS_MAX]);

#endif
