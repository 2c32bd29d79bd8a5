// An I2C port of the chip with its pins, and its registers set up for 400 kHz.
#ifndef FMFTS_I2C_PORT_H
#define FMFTS_I2C_PORT_H

#include <stdint.h>

#include "registers.h"

struct i2c_pins {
    uint8_t scl, sda, mux_reset; // on port B; the switches' RESET (active low) is optional
};

struct i2c_port {
    struct i2c *registers;
    struct i2c_pins pins;
    uint8_t apb1_mhz;
    uint32_t begun_us; // start of the running transfer
};

// Resets the port's peripheral and sets its clocks. No transfer may be running.
void i2c_configure(const struct i2c_port *port);

#endif
