// Pins: sets the mode, writes and reads the level.
#ifndef FMFTS_GPIO_H
#define FMFTS_GPIO_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

// CNF and MODE bits, RM0008 table 20. Slow edges (2 MHz) suffice for I2C at 400 kHz and disturb the sensors less.
enum gpio_mode {
    GPIO_PUSH_PULL = 0x2,
    GPIO_OPEN_DRAIN = 0x6,
    GPIO_PULLED_INPUT = 0x8,
    GPIO_ALTERNATE_PUSH_PULL = 0xA,
    GPIO_ALTERNATE_OPEN_DRAIN = 0xE,
};

static inline void gpio_configure(struct gpio *port, unsigned pin, enum gpio_mode mode)
{
    volatile uint32_t *configuration = pin < 8 ? &port->CRL : &port->CRH;
    unsigned shift = 4 * (pin % 8);
    *configuration = (*configuration & ~(0xFU << shift)) | (uint32_t)mode << shift;
}

static inline void gpio_set(struct gpio *port, unsigned pin, bool high)
{
    port->BSRR = 1U << (high ? pin : pin + 16);
}

static inline bool gpio_is_high(const struct gpio *port, unsigned pin)
{
    return port->IDR >> pin & 1;
}

#endif
