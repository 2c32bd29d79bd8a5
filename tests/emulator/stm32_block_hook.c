// Runs before each translated block: counts time, and stops the CPU when something is due. In C, because a Python
// callback per block is slower than the real chip by a factor of ten.
#include <stdint.h>

struct clock {
    uint64_t now;
    uint64_t deadline;
    uint64_t ticks_per_cycle;
    uint64_t stopped;
    uint64_t trap_page; // exception returns land here
    int (*stop)(void *engine);
};

enum { PAGE_BITS = 12, BRANCH_CYCLES = 2 };

// A halfword a cycle and two to refill the pipeline: within a third of what a Cortex-M3 needs for such code.
void on_block(void *engine, uint64_t address, uint32_t size, void *context)
{
    struct clock *clock = context;
    if (clock->now >= clock->deadline || address >> PAGE_BITS == clock->trap_page) {
        clock->stopped = 1;
        clock->stop(engine);
        return;
    }
    clock->now += (size / 2 + BRANCH_CYCLES) * clock->ticks_per_cycle;
}
