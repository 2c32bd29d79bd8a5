#include "chip_bench.h"

#include "harness.h"

struct bench bench;
struct emulated_chip chips[2];
const struct bus *const bus = &bench.buses[0];
struct emulated_bus *const lines = &bench.lines[0];

const struct hmc5983_config continuous = {.gain_code = 3, .mode = HMC5983_CONTINUOUS};

void begin(void)
{
    bench_init(&bench);
    struct emulated_switch *sw = bench_add_switch(&bench, 0, SWITCH);
    for (int i = 0; i < 2; i++) {
        emulated_chip_init(&chips[i], 1);
        sw->chips[i] = &chips[i].part;
    }
    for (int axis = 0; axis < 3; axis++) {
        chips[0].field_ut[axis] = 100.0 * (axis + 1) / 6.6;
        chips[1].field_ut[axis] = (axis == 1 ? 100.0 : -100.0) * (axis + 4) / 6.6;
    }
}

void pass(uint64_t ns)
{
    bench_pass_time(&bench, ns);
}

void begin_continuous(void)
{
    begin();
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 3), BUS_OK);
    CHECK_EQUAL(hmc5983_configure(bus, &continuous), BUS_OK);
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 1), BUS_OK);
    pass(50 * MS);
}

void check_counts(const int16_t counts[3], int x, int y, int z)
{
    CHECK_EQUAL(counts[0], x);
    CHECK_EQUAL(counts[1], y);
    CHECK_EQUAL(counts[2], z);
}

void read_raw(uint8_t number, uint8_t *bytes, size_t count)
{
    CHECK_EQUAL(bus->read_register(bus->context, HMC5983_ADDRESS, number, bytes, count), BUS_OK);
}

bool is_ready(void)
{
    uint8_t status = 0;
    CHECK_EQUAL(hmc5983_read_status(bus, &status), BUS_OK);
    return status & HMC5983_READY;
}
