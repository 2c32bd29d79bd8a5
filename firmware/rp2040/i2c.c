#include "i2c.h"

#include <stdbool.h>
#include <stddef.h>

#include "registers.h"

enum {
    BAUD = 400000,
    FREE_LIMIT_US = 100,
    TRANSFER_LIMIT_US = 1000, // the longest transfer of the core takes 0.3 ms
    HALF_CLOCK_US = 3,        // half a clock of recovery by hand: 160 kHz
    CLOCKS_MAX = 9,
    MUX_RESET_US = 2,
};

static bool is_late(const struct i2c_port *port, uint32_t limit_us)
{
    return TIMERAWL - port->begun_us > limit_us;
}

static void wait_us(uint32_t us)
{
    uint32_t begun_us = TIMERAWL;
    while (TIMERAWL - begun_us <= us) {
    }
}

static bool is_high(uint8_t pin)
{
    return SIO->GPIO_IN >> pin & 1;
}

static bool lines_are_free(const struct i2c_port *port)
{
    return is_high(port->sda) && is_high(port->scl);
}

static void set_up(const struct i2c_port *port)
{
    volatile struct i2c *i2c = port->registers;
    uint32_t period = port->clock_hz / BAUD, low = period * 3 / 5;
    i2c->ENABLE = 0;
    i2c->CON = I2C_CON_MASTER_FAST;
    i2c->FS_SCL_HCNT = period - low;
    i2c->FS_SCL_LCNT = low;
    i2c->FS_SPKLEN = low / 16;
    i2c->SDA_HOLD = port->clock_hz / 10000000 * 3 + 1; // 0.3 µs
    i2c->INTR_MASK = 0;
}

static enum bus_result begin(struct i2c_port *port, uint8_t address)
{
    port->begun_us = TIMERAWL;
    while (!lines_are_free(port))
        if (is_late(port, FREE_LIMIT_US))
            return BUS_STUCK;
    port->registers->ENABLE = 0;
    port->registers->TAR = address;
    port->registers->ENABLE = 1;
    (void)port->registers->CLR_INTR;
    return BUS_OK;
}

static bool put(const struct i2c_port *port, uint32_t command)
{
    while (!(port->registers->STATUS & I2C_STATUS_TFNF))
        if (is_late(port, TRANSFER_LIMIT_US))
            return false;
    port->registers->DATA_CMD = command;
    return true;
}

// Waits for STOP, which also follows a byte that nobody acknowledged. After an abort for another reason no STOP comes.
static enum bus_result end(const struct i2c_port *port)
{
    volatile struct i2c *i2c = port->registers;
    enum bus_result result = BUS_OK;
    while (!(i2c->RAW_INTR_STAT & I2C_INTR_STOP_DET)) {
        if (is_late(port, TRANSFER_LIMIT_US))
            return BUS_TIMEOUT;
        if (result == BUS_OK && (i2c->RAW_INTR_STAT & I2C_INTR_TX_ABRT)) {
            if (!(i2c->TX_ABRT_SOURCE & I2C_ABRT_NOACK))
                return BUS_ARBITRATION;
            result = BUS_NO_ANSWER;
        }
    }
    if (i2c->RAW_INTR_STAT & I2C_INTR_TX_ABRT)
        result = BUS_NO_ANSWER;
    (void)i2c->CLR_TX_ABRT; // until this read the port discards all bytes
    return result;
}

// The sixteen bytes of the receiver hold everything that is read.
static enum bus_result transfer(struct i2c_port *port, uint8_t address, const uint8_t *out, size_t out_count, uint8_t *in,
                                size_t in_count)
{
    bool taken = true;
    enum bus_result result = begin(port, address);
    if (result != BUS_OK)
        return result;
    for (size_t i = 0; i < out_count && taken; i++)
        taken = put(port, out[i] | (i + 1 == out_count && in_count == 0 ? I2C_DATA_STOP : 0));
    for (size_t i = 0; i < in_count && taken; i++)
        taken = put(port, I2C_DATA_READ | (i == 0 && out_count ? I2C_DATA_RESTART : 0) |
                              (i + 1 == in_count ? I2C_DATA_STOP : 0));
    result = end(port);
    for (size_t i = 0; i < in_count && result == BUS_OK; i++) {
        if (!(port->registers->STATUS & I2C_STATUS_RFNE))
            return BUS_TIMEOUT;
        in[i] = (uint8_t)port->registers->DATA_CMD;
    }
    return result;
}

static enum bus_result write(void *context, uint8_t address, const uint8_t *bytes, size_t count)
{
    return transfer(context, address, bytes, count, NULL, 0);
}

static enum bus_result read(void *context, uint8_t address, uint8_t *bytes, size_t count)
{
    return transfer(context, address, NULL, 0, bytes, count);
}

static enum bus_result read_register(void *context, uint8_t address, uint8_t number, uint8_t *bytes, size_t count)
{
    return transfer(context, address, &number, 1, bytes, count);
}

// By hand a line is driven low, or released to its pull-up.
static void drive(uint8_t pin, bool low)
{
    if (low)
        SIO->GPIO_OE_SET = 1U << pin;
    else
        SIO->GPIO_OE_CLR = 1U << pin;
    wait_us(HALF_CLOCK_US);
}

static void pulse_mux_reset(const struct i2c_port *port)
{
    SIO->GPIO_OE_SET = 1U << port->mux_reset;
    wait_us(MUX_RESET_US);
    SIO->GPIO_OE_CLR = 1U << port->mux_reset;
}

static void take_pins(const struct i2c_port *port, uint32_t function)
{
    const uint8_t pins[] = {port->sda, port->scl};
    SIO->GPIO_OE_CLR = 1U << port->sda | 1U << port->scl;
    SIO->GPIO_OUT_CLR = 1U << port->sda | 1U << port->scl;
    for (int i = 0; i < 2; i++) {
        PADS_BANK0->GPIO[pins[i]] = PAD_PULLED_UP;
        IO_BANK0->GPIO[pins[i]].CTRL = function;
    }
}

static enum bus_result recover(void *context)
{
    struct i2c_port *port = context;
    take_pins(port, FUNCTION_SIO);
    for (int clocks = 0; clocks < CLOCKS_MAX && !is_high(port->sda); clocks++) {
        drive(port->scl, true);
        drive(port->scl, false);
    }
    if (!lines_are_free(port))
        pulse_mux_reset(port); // a switch disconnects the sensor that holds a line
    drive(port->sda, true); // START and STOP
    drive(port->sda, false);
    bool are_free = lines_are_free(port);
    take_pins(port, FUNCTION_I2C);
    set_up(port);
    return are_free ? BUS_OK : BUS_STUCK;
}

enum bus_result i2c_start(struct i2c_port *port, struct bus *bus)
{
    *bus = (struct bus){write, read, read_register, recover, port};
    PADS_BANK0->GPIO[port->mux_reset] = PAD_PULLED_UP;
    SIO->GPIO_OE_CLR = 1U << port->mux_reset;
    SIO->GPIO_OUT_CLR = 1U << port->mux_reset;
    IO_BANK0->GPIO[port->mux_reset].CTRL = FUNCTION_SIO;
    return recover(port);
}
