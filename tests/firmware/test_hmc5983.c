// The driver, and drivers that make the mistakes of published ones, on an emulated chip behind an emulated switch.
#include <string.h>

#include "../../firmware/core/hmc5983.h"
#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/bench.h"
#include "harness.h"

enum { MS = 1000000, SWITCH = 0x70 };

static struct bench bench;
static struct emulated_chip chips[2];
static const struct bus *bus = &bench.buses[0];
static struct emulated_bus *lines = &bench.lines[0];

static const struct hmc5983_config continuous = {.gain_code = 3, .mode = HMC5983_CONTINUOUS};

// Fields that read 100, 200, 300 and −400, 500, −600 counts at gain code 3 (660 LSB/G).
static void begin(void)
{
    bench_init(&bench);
    struct emulated_switch *sw = bench_add_switch(&bench, 0, SWITCH);
    for (int i = 0; i < 2; i++) {
        emulated_chip_init(&chips[i], 1);
        sw->chips[i] = &chips[i];
    }
    for (int axis = 0; axis < 3; axis++) {
        chips[0].field_ut[axis] = 100.0 * (axis + 1) / 6.6;
        chips[1].field_ut[axis] = (axis == 1 ? 100.0 : -100.0) * (axis + 4) / 6.6;
    }
}

static void pass(uint64_t ns)
{
    bench_pass_time(&bench, ns);
}

static void begin_continuous(void)
{
    begin();
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 3), BUS_OK);
    CHECK_EQUAL(hmc5983_configure(bus, &continuous), BUS_OK);
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 1), BUS_OK);
    pass(50 * MS);
}

static void check_counts(const int16_t counts[3], int x, int y, int z)
{
    CHECK_EQUAL(counts[0], x);
    CHECK_EQUAL(counts[1], y);
    CHECK_EQUAL(counts[2], z);
}

static void read_raw(uint8_t number, uint8_t *bytes, size_t count)
{
    CHECK_EQUAL(bus->read_register(bus->context, HMC5983_ADDRESS, number, bytes, count), BUS_OK);
}

static bool is_ready(void)
{
    uint8_t status = 0;
    CHECK_EQUAL(hmc5983_read_status(bus, &status), BUS_OK);
    return status & HMC5983_READY;
}

TEST(driver_reads_each_axis_where_it_is)
{
    int16_t counts[3];
    begin_continuous();
    CHECK_EQUAL(hmc5983_read(bus, counts), BUS_OK);
    check_counts(counts, 100, 200, 300);
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 2), BUS_OK);
    CHECK_EQUAL(hmc5983_read(bus, counts), BUS_OK);
    check_counts(counts, -400, 500, -600);
}

TEST(driver_scales_with_every_gain_code)
{
    static const int lsb_per_gauss[] = {1370, 1090, 820, 660, 440, 390, 330, 230};
    begin_continuous();
    chips[0].field_ut[0] = 50.0;
    for (uint8_t gain_code = 0; gain_code < HMC5983_GAIN_CODES; gain_code++) {
        const struct hmc5983_config config = {.gain_code = gain_code};
        int16_t counts[3];
        hmc5983_configure(bus, &config);
        pass(20 * MS);
        hmc5983_read(bus, counts);
        CHECK_EQUAL(counts[0], lsb_per_gauss[gain_code] / 2);
    }
}

TEST(driver_finds_identification_and_configuration)
{
    uint8_t identification[3] = {0}, registers[2];
    bool held = false;
    begin_continuous();
    CHECK_EQUAL(hmc5983_identify(bus, identification), BUS_OK);
    CHECK(hmc5983_is_identification(identification));
    CHECK(!hmc5983_is_identification((const uint8_t *)"H44"));
    CHECK(!hmc5983_is_identification((const uint8_t *)"H53"));
    CHECK(!hmc5983_is_identification((const uint8_t *)"Q43"));
    CHECK_EQUAL(hmc5983_verify(bus, &continuous, &held), BUS_OK);
    CHECK(held);
    read_raw(HMC5983_CONFIG_A, registers, 2);
    CHECK_EQUAL(registers[0], 0x9C); // compensated, no averaging, 220 Hz
    CHECK_EQUAL(registers[1], 0x60);
    chips[0].config_a &= 0x7F; // compensation lost
    CHECK_EQUAL(hmc5983_verify(bus, &continuous, &held), BUS_OK);
    CHECK(!held);
}

TEST(driver_passes_errors_of_the_bus_on)
{
    static const enum bus_result errors[] = {BUS_NO_ANSWER, BUS_TIMEOUT, BUS_ARBITRATION, BUS_STUCK};
    uint8_t bytes[3];
    int16_t counts[3] = {1, 2, 3};
    bool held;
    begin_continuous();
    for (int i = 0; i < 4; i++) {
        lines->fail_count = 7;
        lines->fail_result = errors[i];
        CHECK_EQUAL(hmc5983_identify(bus, bytes), errors[i]);
        CHECK_EQUAL(hmc5983_configure(bus, &continuous), errors[i]);
        CHECK_EQUAL(hmc5983_verify(bus, &continuous, &held), errors[i]);
        CHECK_EQUAL(hmc5983_trigger(bus), errors[i]);
        CHECK_EQUAL(hmc5983_read_status(bus, bytes), errors[i]);
        CHECK_EQUAL(hmc5983_read(bus, counts), errors[i]);
        CHECK_EQUAL(hmc5983_read_temperature(bus, counts), errors[i]);
        check_counts(counts, 1, 2, 3);
    }
}

TEST(temperature_is_raw_over_128_from_25_degrees)
{
    int16_t raw = 0;
    begin_continuous();
    chips[0].temperature_c = 22.5;
    pass(20 * MS);
    CHECK_EQUAL(hmc5983_read_temperature(bus, &raw), BUS_OK);
    CHECK_EQUAL(raw, -320);
}

TEST(saturated_axis_reads_minus_4096_and_the_others_go_on)
{
    int16_t counts[3];
    begin_continuous();
    chips[0].field_ut[1] = 400.0; // 4 G in the ±2.5 G range
    pass(20 * MS);
    hmc5983_read(bus, counts);
    check_counts(counts, 100, HMC5983_OVERFLOW, 300);
}

TEST(one_trigger_through_the_switch_starts_all_sensors_at_once)
{
    const struct hmc5983_config idle = {.gain_code = 3, .mode = HMC5983_IDLE};
    begin();
    tca9548a_select(bus, SWITCH, 3);
    hmc5983_configure(bus, &idle);
    hmc5983_trigger(bus);
    pass(7 * MS);
    hmc5983_trigger(bus);
    pass(7 * MS);
    for (int i = 0; i < 2; i++) {
        int16_t counts[3];
        tca9548a_select(bus, SWITCH, (uint8_t)(1 << i));
        CHECK(is_ready());
        hmc5983_read(bus, counts);
        CHECK_EQUAL(counts[0], i ? -400 : 100);
    }
    CHECK_EQUAL(chips[0].last_conversion_ns, chips[1].last_conversion_ns);
}

// --- What the emulation does to drivers that get it wrong ---

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

// --- Self-test judgement ---

static struct wire_selftest_sensor judge(int unbiased, int positive, int negative)
{
    const int16_t u[3] = {(int16_t)unbiased, 0, 0}, p[3] = {(int16_t)positive, 450, 420},
                  n[3] = {(int16_t)negative, -450, -420};
    struct wire_selftest_sensor result;
    hmc5983_judge_selftest(u, p, n, &result);
    return result;
}

TEST(selftest_accepts_the_data_sheets_limits_and_nothing_beyond)
{
    CHECK_EQUAL(judge(0, 243, -575).state, SENSOR_OK);
    CHECK_EQUAL(judge(0, 575, -243).state, SENSOR_OK);
    CHECK_EQUAL(judge(0, 242, -450).state, SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(judge(0, 576, -450).state, SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(judge(0, 450, -242).state, SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(judge(0, 450, -576).state, SENSOR_SELFTEST_FAILED);
}

TEST(selftest_takes_the_external_field_off_where_the_chip_did_not)
{
    struct wire_selftest_sensor internal = judge(780, 450, -452), external = judge(780, 1230, 328);
    CHECK_EQUAL(internal.state, SENSOR_OK);
    CHECK_EQUAL(external.state, SENSOR_OK);
    CHECK_EQUAL(internal.positive[0], 450);
    CHECK_EQUAL(external.positive[0], 450);
    CHECK_EQUAL(external.negative[0], -452);
}

TEST(selftest_fails_a_strap_that_does_nothing)
{
    CHECK_EQUAL(judge(450, 450, 450).state, SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(judge(450, 0, 0).state, SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(judge(0, 450, 0).state, SENSOR_SELFTEST_FAILED);
}

TEST(selftest_fails_on_saturation_and_says_which_axis)
{
    for (int which = 0; which < 3; which++) {
        struct wire_selftest_sensor result = judge(which == 0 ? -4096 : 0, which == 1 ? -4096 : 450,
                                                   which == 2 ? -4096 : -450);
        CHECK_EQUAL(result.state, SENSOR_SELFTEST_FAILED);
        CHECK_EQUAL(result.positive[0], -4096);
        CHECK_EQUAL(result.negative[0], -4096);
        CHECK_EQUAL(result.positive[1], 450);
    }
}
