// The driver on an emulated chip behind an emulated switch.
#include "chip_bench.h"
#include "harness.h"

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
