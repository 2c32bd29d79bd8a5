// Frees SDA and SCL of a port when a slave holds them low.
#ifndef FMFTS_I2C_RECOVERY_H
#define FMFTS_I2C_RECOVERY_H

#include "../core/bus.h"

// `context` is the struct i2c_port. Sets the port up anew, whether the lines are free or not. BUS_STUCK: the lines are
// not free.
enum bus_result i2c_recover(void *context);

#endif
