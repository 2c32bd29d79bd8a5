#include "i2c_port.h"

enum {
    RATE_KHZ = 400,
    RISE_TIME_NS = 300, // the longest time that fast mode allows
};

void i2c_configure(const struct i2c_port *port)
{
    struct i2c *i2c = port->registers;
    i2c->CR1 = I2C_CR1_SWRST;
    i2c->CR1 = 0;
    i2c->CR2 = port->apb1_mhz;
    // SCL is low for 2·CCR and high for CCR cycles; rounded up, so that the rate stays below the switches' limit.
    i2c->CCR = I2C_CCR_F_S | (port->apb1_mhz * 1000U + 3 * RATE_KHZ - 1) / (3 * RATE_KHZ);
    i2c->TRISE = port->apb1_mhz * RISE_TIME_NS / 1000U + 1;
    i2c->CR1 = I2C_CR1_PE;
}
