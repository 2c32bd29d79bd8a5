// Microseconds since reset, from SysTick, and sleeping until the next interrupt.
#ifndef FMFTS_TIMER_H
#define FMFTS_TIMER_H

#include <stdint.h>

enum { TIMER_TICK_US = 100 };

// May be called again when the core's clock changes; the time continues.
void timer_start(uint32_t core_mhz);

// Wraps after 71 minutes. Do not call it in interrupt handlers.
uint32_t timer_now_us(void);
void timer_wait_us(uint32_t us);

// Returns after any interrupt, at the latest after the next tick.
void timer_sleep(void);

#endif
