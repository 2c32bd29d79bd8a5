// One switch with two chips, for tests of drivers.
#ifndef FMFTS_TEST_CHIP_BENCH_H
#define FMFTS_TEST_CHIP_BENCH_H

#include "../../firmware/core/hmc5983.h"
#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/bench.h"

enum { MS = 1000000, SWITCH = 0x70 };

extern struct bench bench;
extern struct emulated_chip chips[2];
extern const struct bus *const bus;
extern struct emulated_bus *const lines;
extern const struct hmc5983_config continuous; // gain code 3

// Fields that read 100, 200, 300 and −400, 500, −600 counts at gain code 3 (660 LSB/G).
void begin(void);
// Both chips converting, channel 0 on, the first samples there.
void begin_continuous(void);
void pass(uint64_t ns);
void check_counts(const int16_t counts[3], int x, int y, int z);
void read_raw(uint8_t number, uint8_t *bytes, size_t count);
bool is_ready(void);

#endif
