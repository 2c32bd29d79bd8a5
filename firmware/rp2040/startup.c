#include "startup.h"

#include <stdint.h>
#include <string.h>

#include "registers.h"
#include "usb_registers.h"

// rp2040.ld defines these.
extern uint32_t stack_end[], data_image[], data_begin[], data_end[], bss_begin[], bss_end[];

_Noreturn void system_reset(void)
{
    WATCHDOG->CTRL |= WATCHDOG_TRIGGER;
    for (;;) {
    }
}

static void reset_handler(void)
{
    memcpy(data_begin, data_image, (size_t)((uint8_t *)data_end - (uint8_t *)data_begin));
    memset(bss_begin, 0, (size_t)((uint8_t *)bss_end - (uint8_t *)bss_begin));
    main();
    system_reset();
}

// Faults and unexpected interrupts reset the chip; the hello then reports a software reset.
static void unexpected_handler(void)
{
    system_reset();
}

typedef void (*handler)(void);

enum { CORE_EXCEPTIONS = 16, RP2040_INTERRUPTS = 26 };

__attribute__((section(".vectors"), used)) static const struct {
    const uint32_t *stack;
    handler handlers[CORE_EXCEPTIONS + RP2040_INTERRUPTS - 1];
} vectors = {
    .stack = stack_end,
    .handlers =
        {
            reset_handler,
            [1 ... CORE_EXCEPTIONS + USBCTRL_IRQ - 2] = unexpected_handler,
            [CORE_EXCEPTIONS + USBCTRL_IRQ - 1] = usbctrl_handler,
            [CORE_EXCEPTIONS + USBCTRL_IRQ... CORE_EXCEPTIONS + UART0_IRQ - 2] = unexpected_handler,
            [CORE_EXCEPTIONS + UART0_IRQ - 1] = uart0_handler,
            [CORE_EXCEPTIONS + UART0_IRQ... CORE_EXCEPTIONS + RP2040_INTERRUPTS - 2] = unexpected_handler,
        },
};
