#include "load_cell_pins.h"

#include <stddef.h>

#include "gpio.h"
#include "timer.h"

enum { DATA_PIN = 0, CLOCK_PIN = 1, LEVEL_US = 1 }; // of port A

static bool data_is_high(void *context)
{
    (void)context;
    return gpio_is_high(GPIOA, DATA_PIN);
}

static void set_clock(void *context, bool high)
{
    (void)context;
    gpio_set(GPIOA, CLOCK_PIN, high);
    timer_wait_us(LEVEL_US);
}

static const struct load_cell_pins pins = {data_is_high, set_clock, NULL};

const struct load_cell_pins *load_cell_pins_start(void)
{
    gpio_set(GPIOA, CLOCK_PIN, false);
    gpio_configure(GPIOA, CLOCK_PIN, GPIO_PUSH_PULL);
    gpio_set(GPIOA, DATA_PIN, true); // pulled up: without a converter the line never goes low, which means "ready"
    gpio_configure(GPIOA, DATA_PIN, GPIO_PULLED_INPUT);
    return &pins;
}
