#include "timer.h"

#include "registers.h"
#include "startup.h"

static volatile uint32_t ticks;
static uint32_t cycles_per_us;

void systick_handler(void)
{
    ticks++;
}

void timer_start(uint32_t core_mhz)
{
    STK->CTRL = 0;
    cycles_per_us = core_mhz;
    STK->LOAD = TIMER_TICK_US * core_mhz - 1;
    STK->VAL = 0;
    STK->CTRL = STK_CTRL_CLKSOURCE | STK_CTRL_TICKINT | STK_CTRL_ENABLE;
}

uint32_t timer_now_us(void)
{
    uint32_t begun, remaining;
    // Some cycles pass between the wrap of the counter and its interrupt; then `ticks` and the counter do not match,
    // and both are read again. ICSR is read before `ticks`, because the interrupt clears it before it counts.
    do {
        begun = ticks;
        remaining = STK->VAL;
    } while ((SCB->ICSR & SCB_ICSR_PENDSTSET) || begun != ticks);
    return begun * TIMER_TICK_US + (STK->LOAD - remaining) / cycles_per_us;
}

void timer_wait_us(uint32_t us)
{
    uint32_t begun_us = timer_now_us();
    while (timer_now_us() - begun_us <= us) {
    }
}

void timer_sleep(void)
{
    __asm__ volatile("wfi");
}
