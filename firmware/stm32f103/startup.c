#include "startup.h"

#include <stdint.h>
#include <string.h>

#include "registers.h"

// stm32f103c8.ld defines these.
extern uint32_t stack_end[], data_image[], data_begin[], data_end[], bss_begin[], bss_end[];

_Noreturn void system_reset(void)
{
    SCB->AIRCR = SCB_AIRCR_VECTKEYSTAT_WRITE | SCB_AIRCR_SYSRESETREQ;
    for (;;) {
    }
}

void reset_handler(void)
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

enum { CORE_EXCEPTIONS = 16, NMI = 2, SYSTICK = 15, STM32F103_INTERRUPTS = 43 };

__attribute__((section(".vectors"), used)) static const struct {
    const uint32_t *stack;
    handler handlers[CORE_EXCEPTIONS + STM32F103_INTERRUPTS - 1];
} vectors = {
    .stack = stack_end,
    .handlers =
        {
            reset_handler,
            [NMI - 1] = nmi_handler,
            [NMI... SYSTICK - 2] = unexpected_handler,
            [SYSTICK - 1] = systick_handler,
            [SYSTICK... CORE_EXCEPTIONS + USART1_IRQ - 2] = unexpected_handler,
            [CORE_EXCEPTIONS + USART1_IRQ - 1] = usart1_handler,
            [CORE_EXCEPTIONS + USART1_IRQ... CORE_EXCEPTIONS + STM32F103_INTERRUPTS - 2] = unexpected_handler,
        },
};
