#include "emulation.h"

#include <string.h>

enum { IDLE_STEP_NS = 50000, JUMP_STEP_US = 1 << 30 };

static const uint8_t i2c_ports[BENCH_BUSES] = {1, 2};
static const double noise_ut = 0.2; // 2 mG: the data sheet's noise at the highest gain

// Clock errors within the data sheet's ±3 %, one for each chip.
static const double clock_ppm[SAMPLER_PADS_MAX][SAMPLER_SENSORS_MAX] = {
    {8000, -12000, 3000, -5000},
    {-9000, 14000, -2000, 6000},
    {11000, -7000, 1000, -15000},
};

static uint32_t now_us(void *context)
{
    return bench_now_us(&((struct emulation *)context)->bench);
}

static bool send_line(void *context, const uint8_t *line, size_t count)
{
    struct emulation *emulation = context;
    return emulation->send(emulation->line_context, line, count);
}

void emulation_init(struct emulation *emulation, uint8_t pad_count, const uint8_t uid[WIRE_UID_SIZE],
                    bool (*send)(void *line_context, const uint8_t *line, size_t count), void *line_context)
{
    memset(emulation, 0, sizeof *emulation);
    emulation->send = send;
    emulation->line_context = line_context;
    bench_init(&emulation->bench);
    for (uint8_t p = 0; p < pad_count; p++) {
        uint8_t bus = p == 2, address = (uint8_t)(p == 1 ? 0x71 : 0x70);
        emulation->wiring[p] = (struct pad_wiring){bus, address, SAMPLER_SENSORS_MAX, {0, 1, 2, 3}};
        emulation->switches[p] = bench_add_switch(&emulation->bench, bus, address);
        for (int i = 0; i < SAMPLER_SENSORS_MAX; i++) {
            struct emulated_chip *chip = &emulation->chips[p][i];
            emulated_chip_init(chip, (uint32_t)(p * SAMPLER_SENSORS_MAX + i + 1));
            chip->noise_ut = noise_ut;
            chip->ppm = clock_ppm[p][i];
            emulation->switches[p]->chips[i] = &chip->part;
        }
    }
    emulated_converter_init(&emulation->converter, &emulation->bench);
    emulation->board = (struct board){
        .buses = emulation->bench.buses,
        .bus_count = BENCH_BUSES,
        .i2c_ports = i2c_ports,
        .pads = emulation->wiring,
        .pad_count = pad_count,
        .load_cell = &emulation->converter.pins,
        .reset_cause = RESET_POWER_ON,
        .clock_source = CLOCK_HOST,
        .now_us = now_us,
        .send = send_line,
        .context = emulation,
    };
    memcpy(emulation->board.uid, uid, WIRE_UID_SIZE);
    device_init(&emulation->device, &emulation->board);
}

void emulation_reset(struct emulation *emulation)
{
    for (int p = 0; p < SAMPLER_PADS_MAX; p++)
        emulation->frames_before_reset[p] += emulation->device.sampler.pads[p].sequence;
    emulation->bench.reset_ns = emulation->bench.now_ns;
    emulation->bench.counter_at_reset = 0;
    emulation->board.reset_cause = RESET_SOFTWARE;
    device_init(&emulation->device, &emulation->board);
}

void emulation_run_until(struct emulation *emulation, uint64_t virtual_ns)
{
    while (emulation->bench.now_ns < virtual_ns)
        if (!device_poll(&emulation->device))
            bench_pass_time(&emulation->bench, IDLE_STEP_NS);
}

void emulation_jump(struct emulation *emulation, uint64_t us)
{
    while (us > 0) {
        uint64_t step_us = us < JUMP_STEP_US ? us : JUMP_STEP_US;
        bench_pass_time(&emulation->bench, step_us * 1000);
        clock_now(&emulation->device.clock);
        us -= step_us;
    }
}

void emulation_settle(struct emulation *emulation)
{
    for (int p = 0; p < emulation->board.pad_count; p++)
        for (int i = 0; i < SAMPLER_SENSORS_MAX; i++)
            emulated_chip_advance(&emulation->chips[p][i], emulation->bench.now_ns);
}
