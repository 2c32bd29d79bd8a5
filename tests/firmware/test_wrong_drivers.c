// The emulation's reaction to drivers with the mistakes of published ones.
#include <string.h>

#include "chip_bench.h"
#include "harness.h"

TEST(old_gain_is_in_the_first_sample_after_a_change)
{
    const struct hmc5983_config wide = {.gain_code = 7, .mode = HMC5983_CONTINUOUS};
    int16_t first[3], second[3];
    begin_continuous();
    hmc5983_read(bus, first);
    hmc5983_configure(bus, &wide);
    while (!is_ready()) {
    }
    hmc5983_read(bus, first);
    while (!is_ready()) {
    }
    hmc5983_read(bus, second);
    CHECK_EQUAL(first[0], 100);
    CHECK_EQUAL(second[0], 35);
}

TEST(wrong_driver_that_waits_before_each_axis_never_sees_the_second)
{
    uint8_t axis[2];
    begin_continuous();
    CHECK(is_ready());
    read_raw(0x03, axis, 2);
    for (int poll = 0; poll < 100; poll++) {
        pass(MS);
        CHECK(!is_ready());
    }
}

TEST(wrong_driver_that_reads_two_axes_is_frozen)
{
    uint8_t before[4], after[4];
    begin_continuous();
    read_raw(0x03, before, 4);
    chips[0].field_ut[0] = 0;
    pass(100 * MS);
    read_raw(0x03, after, 4);
    CHECK(memcmp(before, after, 4) == 0);
}

TEST(wrong_driver_that_reads_the_mode_register_is_frozen)
{
    uint8_t mode;
    int16_t counts[3];
    begin_continuous();
    read_raw(HMC5983_MODE, &mode, 1);
    chips[0].field_ut[0] = 0;
    pass(100 * MS);
    CHECK_EQUAL(hmc5983_read(bus, counts), BUS_OK);
    CHECK_EQUAL(counts[0], 100);
    pass(100 * MS);
    CHECK_EQUAL(hmc5983_read(bus, counts), BUS_OK);
    CHECK_EQUAL(counts[0], 0); // six bytes read: free again
}

TEST(wrong_driver_with_little_endian_or_xyz_order_reads_other_numbers)
{
    uint8_t data[6];
    begin_continuous();
    read_raw(0x03, data, 6);
    CHECK((int16_t)(data[1] << 8 | data[0]) != 100);
    CHECK((int16_t)(data[2] << 8 | data[3]) != 200);
    CHECK_EQUAL((int16_t)(data[2] << 8 | data[3]), 300);
}

TEST(wrong_driver_that_reads_past_the_data_gets_the_data_again)
{
    uint8_t data[7];
    begin_continuous();
    read_raw(0x03, data, 7);
    CHECK_EQUAL(data[6], data[0]);
}

TEST(wrong_driver_that_ignores_minus_4096_believes_a_strong_field)
{
    int16_t counts[3];
    begin_continuous();
    chips[0].field_ut[0] = 400.0;
    pass(20 * MS);
    hmc5983_read(bus, counts);
    CHECK_BETWEEN(counts[0] / 660.0, -6.3, -6.1); // gauss, of the wrong sign, in a ±2.5 G range
}

TEST(wrong_driver_that_selects_and_reads_in_one_transfer_reads_the_previous_channel)
{
    begin_continuous();
    CHECK(bench_start(lines, SWITCH, false));
    CHECK(bench_put(lines, 2));
    CHECK(bench_start(lines, HMC5983_ADDRESS, false)); // repeated START: no STOP yet
    CHECK(bench_put(lines, HMC5983_DATA));
    CHECK(bench_start(lines, HMC5983_ADDRESS, true));
    uint8_t high = bench_get(lines), low = bench_get(lines);
    bench_stop(lines);
    CHECK_EQUAL((int16_t)(high << 8 | low), 100); // channel 0, although channel 1 reads −400
}

TEST(wrong_driver_that_reads_with_two_channels_on_gets_the_wired_and)
{
    int16_t counts[3];
    begin_continuous();
    tca9548a_select(bus, SWITCH, 3);
    CHECK_EQUAL(hmc5983_read(bus, counts), BUS_OK);
    check_counts(counts, 100 & -400, 200 & 500, 300 & -600);
}

TEST(sensor_does_not_answer_while_no_channel_is_on)
{
    uint8_t identification[3];
    begin_continuous();
    tca9548a_select(bus, SWITCH, 0);
    CHECK_EQUAL(hmc5983_identify(bus, identification), BUS_NO_ANSWER);
}

TEST(wrong_driver_that_joins_configuration_bits_with_and_is_caught_by_the_read_back)
{
    const uint8_t registers[] = {HMC5983_CONFIG_A, HMC5983_TEMPERATURE_COMPENSATION & HMC5983_RATE_220_HZ};
    bool held = true;
    begin_continuous();
    bus->write(bus->context, HMC5983_ADDRESS, registers, sizeof registers);
    hmc5983_verify(bus, &continuous, &held);
    CHECK(!held);
}

TEST(chip_comes_up_with_its_reset_values_and_keeps_read_only_registers)
{
    uint8_t registers[3];
    const uint8_t scribble[] = {0x0A, 1, 2, 3};
    begin();
    tca9548a_select(bus, SWITCH, 1);
    read_raw(HMC5983_CONFIG_A, registers, 2);
    CHECK_EQUAL(registers[0], 0x10);
    CHECK_EQUAL(registers[1], 0x20);
    bus->write(bus->context, HMC5983_ADDRESS, scribble, sizeof scribble);
    read_raw(HMC5983_IDENTIFICATION, registers, 3);
    CHECK(memcmp(registers, "H43", 3) == 0);
}

TEST(uncompensated_chip_loses_sensitivity_when_warm)
{
    const uint8_t uncompensated[] = {HMC5983_CONFIG_A, HMC5983_RATE_220_HZ};
    int16_t counts[3];
    begin_continuous();
    chips[0].temperature_c = 45.0;
    bus->write(bus->context, HMC5983_ADDRESS, uncompensated, sizeof uncompensated);
    pass(20 * MS);
    hmc5983_read(bus, counts);
    CHECK_EQUAL(counts[2], 282); // 20 K × 0.3 %/K = 6 % of 300
}
