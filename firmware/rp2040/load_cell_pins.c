#include "load_cell_pins.h"

#include <stddef.h>

#include "pins.h"
#include "registers.h"

enum { DATA_PIN = PIN_LOAD_CELL_DATA, CLOCK_PIN = PIN_LOAD_CELL_CLOCK };

static bool data_is_high(void *context)
{
    (void)context;
    return SIO->GPIO_IN >> DATA_PIN & 1;
}

static void set_clock(void *context, bool high)
{
    (void)context;
    if (high)
        SIO->GPIO_OUT_SET = 1U << CLOCK_PIN;
    else
        SIO->GPIO_OUT_CLR = 1U << CLOCK_PIN;
    uint32_t begun_us = TIMERAWL;
    while (TIMERAWL - begun_us <= 1) {
    }
}

static const struct load_cell_pins pins = {data_is_high, set_clock, NULL};

const struct load_cell_pins *load_cell_pins_start(void)
{
    PADS_BANK0->GPIO[DATA_PIN] = PAD_PULLED_UP; // without a converter the line never goes low, which means "ready"
    IO_BANK0->GPIO[DATA_PIN].CTRL = FUNCTION_SIO;
    SIO->GPIO_OUT_CLR = 1U << CLOCK_PIN;
    SIO->GPIO_OE_SET = 1U << CLOCK_PIN;
    IO_BANK0->GPIO[CLOCK_PIN].CTRL = FUNCTION_SIO;
    return &pins;
}
