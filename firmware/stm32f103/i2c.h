// The I2C ports as masters at 400 kHz, polled, by the event sequences of RM0008 26.3.3. They implement `struct bus`.
#ifndef FMFTS_I2C_H
#define FMFTS_I2C_H

#include <stdint.h>

#include "../core/bus.h"
#include "registers.h"

struct i2c_pins {
    uint8_t scl, sda, mux_reset; // of port B; the switches' RESET (active low) is optional
};

struct i2c_port {
    struct i2c *registers;
    struct i2c_pins pins;
    uint8_t apb1_mhz;
    uint32_t begun_us; // the running transfer
};

// Frees the lines as `recover` does and sets the port up; `bus` can be used in any case.
enum bus_result i2c_start(struct i2c_port *port, struct bus *bus);

// Shared by i2c.c and i2c_recovery.c.
void i2c_configure(const struct i2c_port *port);
enum bus_result i2c_recover(void *context);

#endif
