#include "clocks.h"

#include <stdbool.h>

#include "../core/device.h"
#include "registers.h"
#include "startup.h"
#include "timer.h"

enum {
    HSI_MHZ = 8,
    HSE_PLL_MHZ = 72, // 8 MHz · 9
    HSI_PLL_MHZ = 64, // 8 MHz / 2 · 16, the most that the internal oscillator allows
    CRYSTAL_LIMIT_US = 20000, // data sheet: 2 ms typically
    PLL_LIMIT_US = 2000,      // data sheet: 0.2 ms at most
};

static bool becomes(const volatile uint32_t *value, uint32_t mask, uint32_t expected, uint32_t limit_us)
{
    uint32_t begun_us = timer_now_us();
    while ((*value & mask) != expected)
        if (timer_now_us() - begun_us > limit_us)
            return false;
    return true;
}

struct clocks clocks_start(void)
{
    timer_start(HSI_MHZ);
    RCC->CR |= RCC_CR_HSEON;
    bool crystal = becomes(&RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY, CRYSTAL_LIMIT_US);
    FLASH->ACR = FLASH_ACR_PRFTBE | FLASH_ACR_LATENCY_2; // two wait states above 48 MHz
    // APB1 may not exceed 36 MHz.
    RCC->CFGR = RCC_CFGR_PPRE1_HALF | (crystal ? RCC_CFGR_PLLSRC_HSE | RCC_CFGR_PLLMUL_9 : RCC_CFGR_PLLMUL_16);
    RCC->CR |= RCC_CR_PLLON;
    if (!becomes(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, PLL_LIMIT_US))
        system_reset();
    RCC->CFGR |= RCC_CFGR_SW_PLL;
    if (!becomes(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL, PLL_LIMIT_US))
        system_reset();
    uint8_t core_mhz = crystal ? HSE_PLL_MHZ : HSI_PLL_MHZ;
    timer_start(core_mhz);
    if (crystal)
        RCC->CR |= RCC_CR_CSSON;
    else
        RCC->CR &= ~RCC_CR_HSEON;
    return (struct clocks){
        .source = crystal ? CLOCK_HSE : CLOCK_HSI,
        .core_mhz = core_mhz,
        .apb1_mhz = core_mhz / 2,
    };
}

// The crystal stopped while it fed the PLL, and the clock security system switched the core to 8 MHz (RM0008 7.2.7).
// Every divider is wrong now; the reset starts from the internal oscillator.
void nmi_handler(void)
{
    RCC->CIR = RCC_CIR_CSSC;
    system_reset();
}
