// Code that runs too often for Python: before each translated block, counting time and stopping the CPU when something
// is due; the reads of SysTick, of which a firmware that times its waits makes a hundred thousand a second; exception
// entry and return, which Unicorn does not do for a Cortex-M.
#include <stddef.h>
#include <stdint.h>

// Unicorn's functions, from the library that Python has loaded.
struct unicorn {
    int (*stop)(void *engine);
    int (*start)(void *engine, uint64_t begin, uint64_t until, uint64_t timeout, size_t count);
    int (*read_registers)(void *engine, const int *numbers, void **values, int count);
    int (*write_registers)(void *engine, const int *numbers, void *const *values, int count);
    int (*read_memory)(void *engine, uint64_t address, void *bytes, size_t count);
    int (*write_memory)(void *engine, uint64_t address, const void *bytes, size_t count);
    int frame[8]; // its numbers for r0 to r3, r12, lr, pc, xpsr
    int stack;
};

struct clock {
    uint64_t now;
    uint64_t deadline;
    uint64_t ticks_per_cycle;
    uint64_t stopped;
    uint64_t pc; // where it stopped
    uint64_t trap_page; // exception returns land here
    uint64_t due; // the next event; nothing below changes by itself before it
    uint64_t systick_runs;
    uint64_t systick_load;
    uint64_t systick_zero; // when the counter reaches zero
    uint64_t icsr;
    const struct unicorn *unicorn;
    uint64_t (*read)(void *engine, uint64_t offset, unsigned size, void *context);
};

enum { SYSTICK_LOAD = 0xE014, SYSTICK_VALUE = 0xE018, ICSR = 0xED04 };

enum { PAGE_BITS = 12, BRANCH_CYCLES = 2 };

// A halfword a cycle and two to refill the pipeline: within a third of what a Cortex-M3 needs for such code.
void on_block(void *engine, uint64_t address, uint32_t size, void *context)
{
    struct clock *clock = context;
    if (clock->now >= clock->deadline || address >> PAGE_BITS == clock->trap_page) {
        clock->stopped = 1;
        clock->unicorn->stop(engine);
        return;
    }
    clock->now += (size / 2 + BRANCH_CYCLES) * clock->ticks_per_cycle;
}

// Offsets are from 0xE0000000. The counter must run from the core's own clock; Python handles everything else.
uint64_t on_core_read(void *engine, uint64_t offset, unsigned size, void *context)
{
    const struct clock *clock = context;
    if (clock->now < clock->due) {
        if (offset == SYSTICK_LOAD)
            return clock->systick_load;
        if (offset == ICSR)
            return clock->icsr;
        if (offset == SYSTICK_VALUE && clock->systick_runs) {
            uint64_t ticks = clock->systick_zero - clock->now;
            uint64_t counts = (ticks + clock->ticks_per_cycle - 1) / clock->ticks_per_cycle;
            return counts <= clock->systick_load ? counts : 0;
        }
    }
    return clock->read(engine, offset, size, 0);
}

enum { LR = 5, PC = 6, XPSR = 7, FRAME = 8, ENTRY_CYCLES = 12, STACK_REALIGNED = 1 << 9, ENDLESS = 0xFFFFFFFE };

static void move_frame(void *engine, const struct unicorn *unicorn, uint32_t registers[FRAME], uint32_t *stack, int count, int writing)
{
    int numbers[FRAME + 1];
    void *values[FRAME + 1];
    numbers[0] = unicorn->stack;
    values[0] = stack;
    for (int i = 0; i < count; i++) {
        numbers[i + 1] = unicorn->frame[i];
        values[i + 1] = &registers[i];
    }
    if (writing)
        unicorn->write_registers(engine, numbers, values, count + 1);
    else
        unicorn->read_registers(engine, numbers, values, count + 1);
}

// Pushes the frame, aligned to eight bytes as CCR.STKALIGN has it (ARMv7-M B1.5.6), and goes to the handler.
void enter_exception(void *engine, struct clock *clock, uint32_t vector)
{
    uint32_t registers[FRAME], stack;
    move_frame(engine, clock->unicorn, registers, &stack, FRAME, 0);
    if (stack & 4)
        registers[XPSR] |= STACK_REALIGNED;
    stack = (stack & ~7U) - sizeof registers;
    clock->unicorn->write_memory(engine, stack, registers, sizeof registers);
    clock->unicorn->read_memory(engine, vector, &registers[PC], sizeof registers[PC]);
    registers[LR] = (uint32_t)(clock->trap_page << PAGE_BITS) | 1;
    registers[PC] |= 1;
    move_frame(engine, clock->unicorn, registers, &stack, PC + 1, 1);
    clock->now += ENTRY_CYCLES * clock->ticks_per_cycle;
}

void leave_exception(void *engine, struct clock *clock)
{
    uint32_t registers[FRAME], stack;
    move_frame(engine, clock->unicorn, registers, &stack, 0, 0);
    clock->unicorn->read_memory(engine, stack, registers, sizeof registers);
    stack += sizeof registers + (registers[XPSR] & STACK_REALIGNED ? 4 : 0);
    registers[XPSR] &= ~(uint32_t)STACK_REALIGNED;
    registers[PC] |= 1;
    move_frame(engine, clock->unicorn, registers, &stack, FRAME, 1);
    clock->now += ENTRY_CYCLES * clock->ticks_per_cycle;
}

// Until the deadline, a WFI, or the end of a handler. Returns Unicorn's error.
int run(void *engine, struct clock *clock)
{
    uint32_t registers[FRAME], stack;
    clock->stopped = 0;
    move_frame(engine, clock->unicorn, registers, &stack, FRAME, 0);
    int error = clock->unicorn->start(engine, registers[PC] | 1, ENDLESS, 0, 0);
    move_frame(engine, clock->unicorn, registers, &stack, FRAME, 0);
    clock->pc = registers[PC];
    return error;
}
