// The firmware core on an STM32F103C8. Pins: docs/firmware.md.
#include "../core/device.h"

#include <string.h>

#include "clocks.h"
#include "gpio.h"
#include "i2c.h"
#include "load_cell_pins.h"
#include "../cortex_m/find_pads.h"
#include "registers.h"
#include "serial.h"
#include "timer.h"

enum {
    PORTS = 2,
    POWER_UP_US = 10000, // data sheets: muxes and sensors answer 0.2 ms after power-up, and the supply may rise slowly
    // The watchdog's clock is 30 to 60 kHz (data sheet), here divided by 8: it resets after 100 to 200 ms. The longest
    // turn of the main loop, with a bus that stays stuck, takes a few ms.
    WATCHDOG_DIVIDER_8 = 1,
    WATCHDOG_RELOAD = 750,
    WATCHDOG_UNLOCK = 0x5555,
    WATCHDOG_FEED = 0xAAAA,
    WATCHDOG_START = 0xCCCC,
};

static struct i2c_port ports[PORTS] = {
    {.registers = I2C1, .pins = {.scl = 6, .sda = 7, .mux_reset = 5}},
    {.registers = I2C2, .pins = {.scl = 10, .sda = 11, .mux_reset = 12}},
};
static const uint8_t port_numbers[PORTS] = {1, 2};
static struct bus buses[PORTS];
static struct board board;
static struct device device;

static uint32_t now_us(void *context)
{
    (void)context;
    return timer_now_us();
}

// Every reset also sets the flag of the reset pin, so that flag is checked last (RM0008 7.3.10).
static enum reset_cause take_reset_cause(void)
{
    uint32_t flags = RCC->CSR;
    RCC->CSR |= RCC_CSR_RMVF;
    return flags & RCC_CSR_LPWRRSTF   ? RESET_LOW_POWER
           : flags & RCC_CSR_WWDGRSTF ? RESET_WINDOW_WATCHDOG
           : flags & RCC_CSR_IWDGRSTF ? RESET_INDEPENDENT_WATCHDOG
           : flags & RCC_CSR_SFTRSTF  ? RESET_SOFTWARE
           : flags & RCC_CSR_PORRSTF  ? RESET_POWER_ON
           : flags & RCC_CSR_PINRSTF  ? RESET_PIN
                                      : RESET_UNKNOWN;
}

static void start_watchdog(void)
{
    IWDG->KR = WATCHDOG_START;
    IWDG->KR = WATCHDOG_UNLOCK;
    IWDG->PR = WATCHDOG_DIVIDER_8;
    IWDG->RLR = WATCHDOG_RELOAD;
    IWDG->KR = WATCHDOG_FEED;
}

static struct pads *start_buses(uint8_t apb1_mhz, enum reset_cause cause)
{
    bool usable[PORTS];
    RCC->APB1ENR |= RCC_APB1ENR_I2C1EN | RCC_APB1ENR_I2C2EN;
    timer_wait_us(POWER_UP_US);
    for (int i = 0; i < PORTS; i++) {
        gpio_set(GPIOB, ports[i].pins.mux_reset, true);
        gpio_configure(GPIOB, ports[i].pins.mux_reset, GPIO_OPEN_DRAIN);
        ports[i].apb1_mhz = apb1_mhz;
        usable[i] = i2c_start(&ports[i], &buses[i]) == BUS_OK;
    }
    bool remembered = cause == RESET_INDEPENDENT_WATCHDOG || cause == RESET_SOFTWARE;
    return find_pads(buses, usable, PORTS, remembered);
}

static void start_board(void)
{
    start_watchdog();
    enum reset_cause cause = take_reset_cause();
    struct clocks clocks = clocks_start();
    RCC->APB2ENR |= RCC_APB2ENR_IOPAEN | RCC_APB2ENR_IOPBEN | RCC_APB2ENR_USART1EN;
    serial_start(clocks.core_mhz);
    struct pads *pads = start_buses(clocks.apb1_mhz, cause);
    board = (struct board){
        .buses = buses,
        .bus_count = PORTS,
        .i2c_ports = port_numbers,
        .pads = pads,
        .load_cell = load_cell_pins_start(),
        .reset_cause = (uint8_t)cause,
        .clock_source = clocks.source,
        .now_us = now_us,
        .send = serial_send,
    };
    const uint32_t unique_id[] = {UNIQUE_ID[0], UNIQUE_ID[1], UNIQUE_ID[2]};
    memcpy(board.uid, unique_id, sizeof board.uid);
}

static void receive(void)
{
    size_t count;
    const uint8_t *bytes = serial_peek(&count);
    device_receive(&device, bytes, count);
    serial_drop(count);
}

int main(void)
{
    start_board();
    device_init(&device, &board);
    for (;;) {
        // The only place that feeds the watchdog: if the loop or the clock stops, the chip is reset.
        IWDG->KR = WATCHDOG_FEED;
        receive();
        if (!device_poll(&device))
            timer_sleep();
    }
}
