#include "i2c_recovery.h"

#include <stdbool.h>

#include "gpio.h"
#include "i2c_port.h"
#include "timer.h"

enum {
    HALF_CLOCK_US = 5,
    RISE_LIMIT_US = 200, // for a slave that stretches the clock
    PULSES_MAX = 9,      // eight bits and the acknowledge, so that the slave reaches the end of its byte
    MUX_RESET_US = 10,   // TCA9548A data sheet: 6 ns; longer, because the wire's capacitance is not known
};

// Sets a line and waits until it has that level. False: it does not reach it within RISE_LIMIT_US.
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

// A slave that was interrupted while it sent a zero holds SDA low until it gets clock pulses.
static bool clock_out(const struct i2c_pins *pins)
{
    for (int pulse = 0; pulse < PULSES_MAX && !gpio_is_high(GPIOB, pins->sda); pulse++)
        if (!drive(pins->scl, false) || !drive(pins->scl, true))
            return false;
    return gpio_is_high(GPIOB, pins->sda) && gpio_is_high(GPIOB, pins->scl);
}

// START and STOP by hand, each level checked. They reset every slave. The edges also unlock the port's analog filters;
// otherwise BUSY stays set (errata sheet ES096, "I2C analog filter may provide wrong value").
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

static void set_line_mode(const struct i2c_pins *pins, enum gpio_mode mode)
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
    set_line_mode(pins, GPIO_OPEN_DRAIN);
    timer_wait_us(HALF_CLOCK_US);
    bool freed = clock_out(pins);
    if (!freed) {
        pulse_mux_reset(pins); // disconnects a sensor behind a mux that holds the lines
        freed = clock_out(pins);
    }
    freed = start_and_stop(pins) && freed;
    set_line_mode(pins, GPIO_ALTERNATE_OPEN_DRAIN);
    i2c_configure(port);
    return freed ? BUS_OK : BUS_STUCK;
}
