// The LIS3MDL's driver alone: facts that a stream shows late or never.
#include "../../firmware/core/chips/chip.h"
#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/emulated_lis3mdl.h"
#include "chip_bench.h"
#include "harness.h"

static struct emulated_lis3mdl chip;
static const struct chip_wires wires = {.bus = &bench.buses[0], .address = 0x1E};
static const struct chip_setup streaming = {.gain_code = 2, .speed = 2, .streams = true}, single = {.gain_code = 2};

static void begin_with_lis3mdl(const struct chip_setup *setup)
{
    bench_init(&bench);
    emulated_lis3mdl_init(&chip, 0x1E, 1);
    bench_add_switch(&bench, 0, SWITCH)->chips[0] = &chip.common.part;
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 1), BUS_OK);
    CHECK_EQUAL(chip_lis3mdl.set_up(&wires, setup), BUS_OK);
}

static bool is_set_up(const struct chip_setup *setup)
{
    bool held = false;
    CHECK_EQUAL(chip_lis3mdl.check(&wires, setup, &held), BUS_OK);
    return held;
}

TEST(lis3mdl_check_sees_every_bit_that_falls_over)
{
    begin_with_lis3mdl(&streaming);
    chip.common.clock_stopped = true;
    for (int number = 0x20; number <= 0x24; number++) {
        for (int bit = 0; bit < 8; bit++) {
            CHECK(is_set_up(&streaming));
            chip.common.registers[number] ^= (uint8_t)(1 << bit);
            CHECK(!is_set_up(&streaming));
            chip.common.registers[number] ^= (uint8_t)(1 << bit);
        }
    }
}

TEST(lis3mdl_check_does_not_take_a_running_measurement_for_a_fault)
{
    begin_with_lis3mdl(&single);
    CHECK(is_set_up(&single));
    CHECK_EQUAL(chip_write(&wires, chip_lis3mdl.trigger->bytes, chip_lis3mdl.trigger->count), BUS_OK);
    CHECK(is_set_up(&single));
    chip.common.registers[0x21] ^= 0x20;
    CHECK(!is_set_up(&single));
}

TEST(lis3mdl_is_set_up_as_its_data_sheet_says)
{
    begin_with_lis3mdl(&streaming);
    CHECK_EQUAL(chip.common.registers[0x20], 0xC2); // thermometer, high performance, fast: 300 Hz (tables 18 to 21)
    CHECK_EQUAL(chip.common.registers[0x21], 0x40); // ±12 G (table 24)
    CHECK_EQUAL(chip.common.registers[0x23], 0x08); // z as x and y
    CHECK_EQUAL(chip.common.registers[0x24], 0x40); // block data update
    begin_with_lis3mdl(&single);
    CHECK_EQUAL(chip.common.registers[0x20], 0xFC); // ultra-high performance, 80 Hz
    CHECK_EQUAL(chip.common.registers[0x22], 0x03); // off, until it is triggered
    CHECK_EQUAL(chip.common.registers[0x23], 0x0C);
}

TEST(lis3mdl_at_the_address_of_an_hmc5983_is_not_taken_for_one)
{
    uint8_t identification[3];
    begin_with_lis3mdl(&streaming);
    CHECK_EQUAL(chip_hmc5983.identify(&wires, identification), BUS_OK);
    CHECK(!chip_hmc5983.is_identification(identification));
    CHECK_EQUAL(chip_lis3mdl.identify(&wires, identification), BUS_OK);
    CHECK(chip_lis3mdl.is_identification(identification));
    CHECK(!chip_lis3mdl.is_identification((const uint8_t *)"H43"));
}
