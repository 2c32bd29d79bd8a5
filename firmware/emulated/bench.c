#include "bench.h"

#include <string.h>

enum {
    BIT_NS = 2500, // 400 kHz
    BYTE_NS = 9 * BIT_NS,
    TIMEOUT_NS = 1000000,
};

void bench_pass_time(struct bench *bench, uint64_t ns)
{
    bench->now_ns += ns;
}

uint32_t bench_now_us(void *context)
{
    const struct bench *bench = context;
    return (uint32_t)((bench->now_ns - bench->reset_ns) / 1000) + bench->counter_at_reset;
}

// Visits the chips on the bus itself and on all connected channels of all its muxes. A wrong driver may talk to several
// at once.
typedef void visitor(struct emulated_part *part, void *argument);

static int visit_part(struct emulated_bus *bus, struct emulated_part *part, visitor *visit, void *argument)
{
    if (!part || !part->present || part->address != bus->address)
        return 0;
    part->kind->advance(part, bus->bench->now_ns);
    visit(part, argument);
    return 1;
}

static int visit_chips(struct emulated_bus *bus, visitor *visit, void *argument)
{
    int answers = 0;
    for (int i = 0; i < SWITCH_CHANNELS; i++)
        answers += visit_part(bus, bus->direct[i], visit, argument);
    for (int s = 0; s < bus->switch_count; s++) {
        struct emulated_switch *sw = &bus->switches[s];
        for (int channel = 0; channel < SWITCH_CHANNELS && sw->present; channel++)
            if (sw->channels >> channel & 1)
                answers += visit_part(bus, sw->chips[channel], visit, argument);
    }
    return answers;
}

static struct emulated_switch *find_switch(struct emulated_bus *bus, uint8_t address)
{
    for (int s = 0; s < bus->switch_count; s++)
        if (bus->switches[s].present && bus->switches[s].address == address)
            return &bus->switches[s];
    return NULL;
}

static void visit_start(struct emulated_part *part, void *argument)
{
    if (!*(bool *)argument)
        part->kind->start_write(part);
}

static void visit_put(struct emulated_part *part, void *argument)
{
    part->kind->put(part, *(uint8_t *)argument);
}

static void visit_get(struct emulated_part *part, void *argument)
{
    *(uint8_t *)argument &= part->kind->get(part); // open drain: any chip's zero wins
}

bool bench_start(struct emulated_bus *bus, uint8_t address, bool reading)
{
    bench_pass_time(bus->bench, BIT_NS + BYTE_NS);
    bus->address = address;
    bus->reading = reading;
    return find_switch(bus, address) != NULL || visit_chips(bus, visit_start, &reading) > 0;
}

bool bench_put(struct emulated_bus *bus, uint8_t byte)
{
    bench_pass_time(bus->bench, BYTE_NS);
    struct emulated_switch *sw = find_switch(bus, bus->address);
    if (!sw)
        return visit_chips(bus, visit_put, &byte) > 0;
    sw->control = byte;
    return true;
}

uint8_t bench_get(struct emulated_bus *bus)
{
    uint8_t byte = 0xFF;
    bench_pass_time(bus->bench, BYTE_NS);
    struct emulated_switch *sw = find_switch(bus, bus->address);
    if (sw)
        return sw->control;
    if (visit_chips(bus, visit_get, &byte) > 1)
        bus->bench->contentions++;
    return byte;
}

void bench_stop(struct emulated_bus *bus)
{
    bench_pass_time(bus->bench, BIT_NS);
    for (int s = 0; s < bus->switch_count; s++)
        bus->switches[s].channels = bus->switches[s].control;
}

static enum bus_result begin_transfer(struct emulated_bus *bus)
{
    bus->transfers++;
    if (bus->stuck || bus->stuck_for_good) {
        bench_pass_time(bus->bench, TIMEOUT_NS);
        return BUS_STUCK;
    }
    if (bus->fail_count > 0) {
        bus->fail_count--;
        if (bus->fail_result != BUS_NO_ANSWER)
            bench_pass_time(bus->bench, TIMEOUT_NS);
        return bus->fail_result;
    }
    return BUS_OK;
}

static bool write_bytes(struct emulated_bus *bus, uint8_t address, const uint8_t *bytes, size_t count)
{
    bool acknowledged = bench_start(bus, address, false);
    for (size_t i = 0; i < count && acknowledged; i++)
        acknowledged = bench_put(bus, bytes[i]);
    return acknowledged;
}

static bool read_bytes(struct emulated_bus *bus, uint8_t address, uint8_t *bytes, size_t count)
{
    bool acknowledged = bench_start(bus, address, true);
    for (size_t i = 0; i < count && acknowledged; i++)
        bytes[i] = bench_get(bus);
    return acknowledged;
}

static enum bus_result end_transfer(struct emulated_bus *bus, bool acknowledged)
{
    bench_stop(bus);
    return acknowledged ? BUS_OK : BUS_NO_ANSWER;
}

static enum bus_result bus_write(void *context, uint8_t address, const uint8_t *bytes, size_t count)
{
    enum bus_result result = begin_transfer(context);
    return result == BUS_OK ? end_transfer(context, write_bytes(context, address, bytes, count)) : result;
}

static enum bus_result bus_read(void *context, uint8_t address, uint8_t *bytes, size_t count)
{
    enum bus_result result = begin_transfer(context);
    return result == BUS_OK ? end_transfer(context, read_bytes(context, address, bytes, count)) : result;
}

static enum bus_result bus_read_register(void *context, uint8_t address, uint8_t number, uint8_t *bytes, size_t count)
{
    enum bus_result result = begin_transfer(context);
    if (result != BUS_OK)
        return result;
    bool acknowledged = write_bytes(context, address, &number, 1) && read_bytes(context, address, bytes, count);
    return end_transfer(context, acknowledged);
}

static enum bus_result bus_recover(void *context)
{
    struct emulated_bus *bus = context;
    bus->recoveries++;
    bus->stuck = false;
    for (int s = 0; s < bus->switch_count; s++)
        bus->switches[s].control = bus->switches[s].channels = 0; // the RESET pin
    return bus->stuck_for_good ? BUS_STUCK : BUS_OK;
}

void bench_init(struct bench *bench)
{
    memset(bench, 0, sizeof *bench);
    for (int i = 0; i < BENCH_BUSES; i++) {
        bench->lines[i].bench = bench;
        bench->buses[i] = (struct bus){bus_write, bus_read, bus_read_register, bus_recover, &bench->lines[i]};
    }
}

struct emulated_switch *bench_add_switch(struct bench *bench, int bus, uint8_t address)
{
    struct emulated_bus *lines = &bench->lines[bus];
    struct emulated_switch *sw = &lines->switches[lines->switch_count++];
    *sw = (struct emulated_switch){.address = address, .present = true};
    return sw;
}

void bench_plug_part(struct emulated_part *part, bool present)
{
    if (present && !part->present)
        part->kind->power_on(part);
    part->present = present;
}

void bench_plug_chip(struct emulated_chip *chip, bool present)
{
    bench_plug_part(&chip->part, present);
}

void bench_plug_switch(struct emulated_switch *sw, bool present)
{
    if (!present)
        sw->control = sw->channels = 0;
    sw->present = present;
}
