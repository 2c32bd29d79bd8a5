#include "i2c_recovery.h"

#include <stdbool.h>

#include "gpio.h"
#include "i2c_port.h"
#include "timer.h"

enum {
    HALF_CLOCK_US = 5,
    RISE_LIMIT_US = 200, // for a slave that stretches the clock
    PULSES_MAX = 9,      // eight bits and the acknowledge: wherever the slave stands, it sees the end of its byte
    MUX_RESET_US = 10,   // TCA9548A data sheet: 6 ns are enough, the wire's capacitance is not known
};

// True when the line has followed.
static bool drive(unsigned pin, bool high)
{
    uint32_t begun_us = timer_now_us();
    gpio_set(GPIOB, pin, high);
    timer_wait_us(HALF_CLOCK_US);
    while (gpio_is_high(GPIOB, pin) != high)
        if (timer_now_us() - begun_us > RISE_LIMIT_US)
            return false;
    return true;
}

// A slave that was interrupted while it sent a zero holds SDA low until it is clocked on.
static bool clock_out(const struct i2c_pins *pins)
{
    for (int pulse = 0; pulse < PULSES_MAX && !gpio_is_high(GPIOB, pins->sda); pulse++)
        if (!drive(pins->scl, false) || !drive(pins->scl, true))
            return false;
    return gpio_is_high(GPIOB, pins->sda) && gpio_is_high(GPIOB, pins->scl);
}

// START and STOP by hand, each level checked. They reset every slave, and the edges unlock the port's analog filters,
// without which BUSY stays set for ever (errata sheet ES096, "I2C analog filter may provide wrong value").
static bool start_and_stop(const struct i2c_pins *pins)
{
    return drive(pins->scl, true) && drive(pins->sda, true) && drive(pins->sda, false) && drive(pins->scl, false) &&
           drive(pins->scl, true) && drive(pins->sda, true);
}

static void pulse_mux_reset(const struct i2c_pins *pins)
{
    gpio_set(GPIOB, pins->mux_reset, false);
    timer_wait_us(MUX_RESET_US);
    gpio_set(GPIOB, pins->mux_reset, true);
    timer_wait_us(MUX_RESET_US);
}

static void hand_lines_to(const struct i2c_pins *pins, enum gpio_mode mode)
{
    gpio_set(GPIOB, pins->scl, true);
    gpio_set(GPIOB, pins->sda, true);
    gpio_configure(GPIOB, pins->scl, mode);
    gpio_configure(GPIOB, pins->sda, mode);
}

enum bus_result i2c_recover(void *context)
{
    const struct i2c_port *port = context;
    const struct i2c_pins *pins = &port->pins;
    port->registers->CR1 = 0;
    hand_lines_to(pins, GPIO_OPEN_DRAIN);
    timer_wait_us(HALF_CLOCK_US);
    bool freed = clock_out(pins);
    if (!freed) {
        pulse_mux_reset(pins); // disconnects whoever holds the lines behind a switch
        freed = clock_out(pins);
    }
    freed = start_and_stop(pins) && freed;
    hand_lines_to(pins, GPIO_ALTERNATE_OPEN_DRAIN);
    i2c_configure(port);
    return freed ? BUS_OK : BUS_STUCK;
}
