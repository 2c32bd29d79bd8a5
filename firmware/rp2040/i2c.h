// The I2C ports as masters at 400 kHz, polled, by section 4.3 of the data sheet. They implement `struct bus`.
#ifndef FMFTS_RP2040_I2C_H
#define FMFTS_RP2040_I2C_H

#include <stdint.h>

#include "../core/bus.h"

struct i2c_port {
    volatile struct i2c *registers;
    uint8_t sda, scl, mux_reset; // pins
    uint32_t clock_hz;
    uint32_t begun_us;
};

// Fills `bus`, frees the lines as `recover` does, and sets up the port. `bus` can be used whatever this returns.
enum bus_result i2c_start(struct i2c_port *port, struct bus *bus);

#endif
