// The I2C ports as masters at 400 kHz, polled, by the event sequences of RM0008 26.3.3. They implement `struct bus`.
#ifndef FMFTS_I2C_H
#define FMFTS_I2C_H

#include "../core/bus.h"
#include "i2c_port.h"

// Fills `bus`, frees the lines as `recover` does and sets the port up. `bus` can be used whatever this returns.
enum bus_result i2c_start(struct i2c_port *port, struct bus *bus);

#endif
