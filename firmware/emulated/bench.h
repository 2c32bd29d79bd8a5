// A bench with two I2C buses, TCA9548A switches and chips on them, in virtual time.
#ifndef FMFTS_EMULATED_BENCH_H
#define FMFTS_EMULATED_BENCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../core/bus.h"
#include "chip.h"

enum { BENCH_BUSES = 2, BENCH_SWITCHES = 4, SWITCH_CHANNELS = 8 };

struct emulated_switch {
    uint8_t address;
    bool present;
    uint8_t channels; // connected now
    uint8_t control;  // written, takes effect at the STOP
    struct emulated_part *chips[SWITCH_CHANNELS];
};

struct emulated_bus {
    struct bench *bench;
    struct emulated_switch switches[BENCH_SWITCHES];
    int switch_count;
    struct emulated_part *direct[SWITCH_CHANNELS]; // on the bus itself, without a switch
    // Faults. A stuck bus fails every transfer; `recover` frees it unless it is stuck for good.
    bool stuck, stuck_for_good;
    int fail_count;              // how many of the next transfers fail with `fail_result`
    enum bus_result fail_result; // all but BUS_NO_ANSWER take as long as a timeout
    // The running transfer.
    uint8_t address;
    bool reading;
    unsigned transfers, recoveries;
};

struct bench {
    uint64_t now_ns;
    uint64_t reset_ns; // the board's counter started here
    uint32_t counter_at_reset;
    struct emulated_bus lines[BENCH_BUSES];
    struct bus buses[BENCH_BUSES]; // the core's access to `lines`
    unsigned contentions;          // counts bytes that more than one chip sent at once
};

void bench_init(struct bench *bench);
struct emulated_switch *bench_add_switch(struct bench *bench, int bus, uint8_t address);
void bench_pass_time(struct bench *bench, uint64_t ns);

// The board's 32-bit microsecond counter; `context` is the bench.
uint32_t bench_now_us(void *context);

// The bus, byte by byte, for tests of wrong drivers that `struct bus` does not allow.
bool bench_start(struct emulated_bus *bus, uint8_t address, bool reading);
bool bench_put(struct emulated_bus *bus, uint8_t byte);
uint8_t bench_get(struct emulated_bus *bus);
void bench_stop(struct emulated_bus *bus);

// Switches the power of a chip or a mux off and on.
void bench_plug_part(struct emulated_part *part, bool present);
void bench_plug_chip(struct emulated_chip *chip, bool present);
void bench_plug_switch(struct emulated_switch *sw, bool present);

#endif
