// The firmware core on an RP2040 (Raspberry Pi Pico, QT Py RP2040). Pins: docs/firmware.md.
#include <string.h>

#include "../core/device.h"
#include "../cortex_m/find_pads.h"
#include "board_id.h"
#include "host_link.h"
#include "i2c.h"
#include "load_cell_pins.h"
#include "pins.h"
#include "registers.h"

enum {
    PORTS = 2,
    CRYSTAL_MHZ = 12,
    CORE_HZ = 125000000,
    SYS_MULTIPLIER = 125, // 1500 MHz, by 6 and by 2
    SYS_DIVIDERS = 6 << 16 | 2 << 12,
    USB_MULTIPLIER = 100, // 1200 MHz, by 5 and by 5
    USB_DIVIDERS = 5 << 16 | 5 << 12,
    POWER_UP_US = 10000,  // muxes and sensors answer 0.2 ms after power-up, and the supply may rise slowly
    // The longest turn of the main loop takes a few ms, while a bus stays stuck. It counts two for each microsecond
    // (erratum RP2040-E1).
    WATCHDOG_LOAD = 2 * 150000,
};

static struct i2c_port ports[PORTS] = {
    {.registers = I2C0, .sda = PIN_SDA_1, .scl = PIN_SCL_1, .mux_reset = PIN_RESET_1, .clock_hz = CORE_HZ},
    {.registers = I2C1, .sda = PIN_SDA_2, .scl = PIN_SCL_2, .mux_reset = PIN_RESET_2, .clock_hz = CORE_HZ},
};
static const uint8_t port_numbers[PORTS] = {1, 2};
static struct bus buses[PORTS];
static struct board board;
static struct device device;

static uint32_t now_us(void *context)
{
    (void)context;
    return TIMERAWL;
}

static enum reset_cause take_reset_cause(void)
{
    uint32_t reason = WATCHDOG->REASON, chip = CHIP_RESET;
    return reason & WATCHDOG_REASON_TIMER   ? RESET_INDEPENDENT_WATCHDOG
           : reason & WATCHDOG_REASON_FORCE ? RESET_SOFTWARE
           : chip & CHIP_RESET_HAD_POR      ? RESET_POWER_ON
           : chip & CHIP_RESET_HAD_RUN      ? RESET_PIN
                                            : RESET_UNKNOWN;
}

static void release(uint32_t blocks)
{
    RESETS->RESET &= ~blocks;
    while ((RESETS->RESET_DONE & blocks) != blocks) {
    }
}

static void start_pll(volatile struct pll *pll, uint32_t block, uint32_t multiplier, uint32_t dividers)
{
    RESETS->RESET |= block;
    release(block);
    pll->CS = 1;
    pll->FBDIV_INT = multiplier;
    pll->PWR &= ~(PLL_PWR_PD | PLL_PWR_VCOPD);
    while (!(pll->CS & PLL_LOCK)) {
    }
    pll->PRIM = dividers;
    pll->PWR &= ~PLL_PWR_POSTDIVPD;
}

// The crystal, and the PLLs on it. Without a crystal the ROM's boot loader has no USB either: such boards do not exist.
static void start_clocks(void)
{
    XOSC->STARTUP = CRYSTAL_STARTUP;
    XOSC->CTRL = XOSC_ENABLE;
    while (!(XOSC->STATUS & XOSC_STABLE)) {
    }
    CLK_SYS->CTRL = CLK_SYS_REF;
    while (!(CLK_SYS->SELECTED & 1U << CLK_SYS_REF)) {
    }
    CLK_REF->CTRL = CLK_REF_XOSC;
    while (!(CLK_REF->SELECTED & 1U << CLK_REF_XOSC)) {
    }
    start_pll(PLL_SYS, RESETS_PLL_SYS, SYS_MULTIPLIER, SYS_DIVIDERS);
    start_pll(PLL_USB, RESETS_PLL_USB, USB_MULTIPLIER, USB_DIVIDERS);
    CLK_SYS->CTRL = CLK_SYS_AUX;
    while (!(CLK_SYS->SELECTED & 1U << CLK_SYS_AUX)) {
    }
    CLK_PERI->CTRL = CLK_ENABLE;
    CLK_USB->CTRL = CLK_ENABLE;
    WATCHDOG->TICK = WATCHDOG_TICK_ENABLE | CRYSTAL_MHZ; // also the timer's microsecond
}

static void start_watchdog(void)
{
    PSM->WDSEL = PSM_ALL_BUT_OSCILLATORS;
    WATCHDOG->LOAD = WATCHDOG_LOAD;
    WATCHDOG->CTRL = WATCHDOG_ENABLE;
}

static void start_board(void)
{
    bool usable[PORTS];
    enum reset_cause cause = take_reset_cause();
    start_clocks();
    release(RESETS_IO_BANK0 | RESETS_PADS_BANK0 | RESETS_TIMER | RESETS_UART0 | RESETS_I2C0 | RESETS_I2C1 | RESETS_USBCTRL);
    start_watchdog();
    uint8_t id[BOARD_ID_SIZE];
    board_id_read(id);
    host_link_start(CORE_HZ, id);
    while (TIMERAWL < POWER_UP_US) {
    }
    for (int i = 0; i < PORTS; i++)
        usable[i] = i2c_start(&ports[i], &buses[i]) == BUS_OK;
    bool remembered = cause == RESET_INDEPENDENT_WATCHDOG || cause == RESET_SOFTWARE;
    struct pads *pads = find_pads(buses, usable, PORTS, remembered);
    board = (struct board){
        .buses = buses,
        .bus_count = PORTS,
        .i2c_ports = port_numbers,
        .pads = pads,
        .load_cell = load_cell_pins_start(),
        .reset_cause = (uint8_t)cause,
        .clock_source = CLOCK_HSE,
        .now_us = now_us,
        .send = host_link_send,
    };
    memcpy(board.uid, id, sizeof id);
}

static void take_from_host(const uint8_t *bytes, size_t count)
{
    device_receive(&device, bytes, count);
}

int main(void)
{
    start_board();
    device_init(&device, &board);
    for (;;) {
        WATCHDOG->LOAD = WATCHDOG_LOAD; // the only place that feeds the watchdog
        host_link_receive(take_from_host);
        device_poll(&device);
    }
}
