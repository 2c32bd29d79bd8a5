// The QMC5883P's driver alone: facts that a stream does not show.
#include "../../firmware/core/chips/chip.h"
#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/emulated_qmc5883p.h"
#include "chip_bench.h"
#include "harness.h"

static struct emulated_qmc5883p chip;
static const struct chip_wires wires = {.bus = &bench.buses[0], .address = 0x2C};

static void begin_with_qmc5883p(void)
{
    bench_init(&bench);
    emulated_qmc5883p_init(&chip, 1);
    bench_add_switch(&bench, 0, SWITCH)->chips[0] = &chip.common.part;
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 1), BUS_OK);
}

TEST(qmc5883p_is_told_by_its_identification_and_no_potentiometer_is)
{
    static const uint8_t right[3] = {0x80, 0x2C, 0}, other[3] = {0x81, 0x2C, 0}, elsewhere[3] = {0x80, 0x2D, 0},
                         potentiometer[3] = {0x80, 0x2C, 0x80}, nobody[3] = {0xFF, 0xFF, 0xFF};
    uint8_t read[3] = {0xAA, 0xAA, 0xAA};
    CHECK(chip_qmc5883p.is_identification(right));
    CHECK(!chip_qmc5883p.is_identification(other));
    CHECK(!chip_qmc5883p.is_identification(elsewhere));
    CHECK(!chip_qmc5883p.is_identification(potentiometer));
    CHECK(!chip_qmc5883p.is_identification(nobody));
    begin_with_qmc5883p();
    for (int number = 0; number < 256; number++)
        chip.common.registers[number] = 0x80; // a potentiometer answers every read with its middle position
    CHECK_EQUAL(chip_qmc5883p.identify(&wires, read), BUS_OK);
    CHECK(!chip_qmc5883p.is_identification(read));
}

// ArduPilot, Adafruit_QMC5883P: control 1 at 0x0A (mode, rate, OSR1, OSR2), control 2 at 0x0B (set and reset, range).
TEST(qmc5883p_is_set_up_as_its_drivers_do_and_check_sees_every_bit)
{
    static const uint8_t ranges[] = {3 << 2, 2 << 2, 1 << 2, 0}; // 2, 8, 12 and 30 G
    for (uint8_t gain_code = 0; gain_code < 4; gain_code++) {
        const struct chip_setup setup = {.gain_code = gain_code, .streams = true};
        bool held = false;
        begin_with_qmc5883p();
        CHECK_EQUAL(chip_qmc5883p.set_up(&wires, &setup), BUS_OK);
        chip.common.clock_stopped = true;
        CHECK_EQUAL(chip.common.registers[0x0A], 3 << 2 | 1); // 200 Hz, normal, 8 times oversampled, no further filter
        CHECK_EQUAL(chip.common.registers[0x0B], ranges[gain_code]); // set and reset on
        CHECK(chip.signs_defined);
        for (int bit = 0; bit < 16; bit++) {
            uint8_t *reg = &chip.common.registers[0x0A + bit / 8];
            CHECK_EQUAL(chip_qmc5883p.check(&wires, &setup, &held), BUS_OK);
            CHECK(held);
            *reg ^= (uint8_t)(1 << bit % 8);
            CHECK_EQUAL(chip_qmc5883p.check(&wires, &setup, &held), BUS_OK);
            CHECK(!held);
            *reg ^= (uint8_t)(1 << bit % 8);
        }
    }
}
