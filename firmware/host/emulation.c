#include "emulation.h"

#include <string.h>

enum { IDLE_STEP_NS = 50000, JUMP_STEP_US = 1 << 30 };

static const uint8_t i2c_ports[BENCH_BUSES] = {1, 2};
static const double noise_ut = 0.2; // 2 mG: the data sheet's noise at the highest gain

// Clock errors within the data sheet's ±3 %, one for each chip.
static const double clock_ppm[SAMPLER_PADS_MAX][PAD_SENSORS_MAX] = {
    {8000, -12000, 3000, -5000, 13000, -1000, -8000, 4000},
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

static void add_chip(struct emulation *emulation, int s)
{
    int i = emulation->chip_count[s]++;
    struct emulated_chip *chip = &emulation->chips[s][i];
    emulated_chip_init(chip, (uint32_t)(s * PAD_SENSORS_FOUND + i + 1 + (i < PAD_SENSORS_FOUND ? 0 : 8)));
    chip->noise_ut = noise_ut;
    chip->ppm = clock_ppm[s][i];
    emulation->switches[s]->chips[i] = &chip->part;
}

// As firmware/cortex_m/find_pads.c finds them.
static void find_pads(struct emulation *emulation)
{
    struct pads *pads = &emulation->pads;
    *pads = (struct pads){.count = 0};
    for (int s = 0; s < emulation->switch_count; s++) {
        const struct emulated_switch *sw = emulation->switches[s];
        for (int first = 0; first < emulation->chip_count[s]; first += PAD_SENSORS_FOUND)
            pads->found[pads->count++] = (struct pad_wiring){s == 2, sw->address, PAD_SENSORS_FOUND, (uint8_t)first};
    }
    pads_seal(pads);
}

void emulation_init(struct emulation *emulation, uint8_t pad_count, const uint8_t uid[WIRE_UID_SIZE],
                    bool (*send)(void *line_context, const uint8_t *line, size_t count), void *line_context)
{
    memset(emulation, 0, sizeof *emulation);
    emulation->send = send;
    emulation->line_context = line_context;
    bench_init(&emulation->bench);
    emulation->switch_count = pad_count;
    for (int s = 0; s < pad_count; s++) {
        emulation->switches[s] = bench_add_switch(&emulation->bench, s == 2, (uint8_t)(s == 1 ? 0x71 : 0x70));
        for (int i = 0; i < PAD_SENSORS_FOUND; i++)
            add_chip(emulation, s);
    }
    find_pads(emulation);
    emulated_converter_init(&emulation->converter, &emulation->bench);
    emulation->board = (struct board){
        .buses = emulation->bench.buses,
        .bus_count = BENCH_BUSES,
        .i2c_ports = i2c_ports,
        .pads = &emulation->pads,
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

static void reset(struct emulation *emulation, enum reset_cause cause)
{
    for (int p = 0; p < SAMPLER_PADS_MAX; p++)
        emulation->frames_before_reset[p] += emulation->device.sampler.pads[p].sequence;
    emulation->bench.reset_ns = emulation->bench.now_ns;
    emulation->bench.counter_at_reset = 0;
    emulation->board.reset_cause = (uint8_t)cause;
    device_init(&emulation->device, &emulation->board);
}

void emulation_reset(struct emulation *emulation)
{
    reset(emulation, RESET_SOFTWARE);
}

void emulation_reset_by_pin(struct emulation *emulation)
{
    find_pads(emulation);
    reset(emulation, RESET_PIN);
}

void emulation_fill_switch(struct emulation *emulation)
{
    while (emulation->chip_count[0] < PAD_SENSORS_MAX)
        add_chip(emulation, 0);
    find_pads(emulation);
    reset(emulation, RESET_POWER_ON);
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
    for (int s = 0; s < emulation->switch_count; s++)
        for (int i = 0; i < emulation->chip_count[s]; i++)
            emulated_chip_advance(&emulation->chips[s][i], emulation->bench.now_ns);
}
