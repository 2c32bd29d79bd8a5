// The self-test as seen by a host; the driver's tests check which results pass.
#include <string.h>

#include "harness.h"
#include "rig.h"

static int16_t counts_at(const uint8_t *selftest, int sensor, int index)
{
    const uint8_t *at = selftest + 4 + 13 * sensor + 1 + 2 * index;
    return (int16_t)(at[0] | at[1] << 8);
}

static const uint8_t *run_selftest(uint8_t id)
{
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, id, 0, 0), RESULT_DONE);
    rig_run_ms(350);
    const uint8_t *result = rig_next(WIRE_SELFTEST);
    CHECK_EQUAL(result[1], id);
    CHECK_EQUAL(result[2], 0x40);
    CHECK_EQUAL(result[3], 5);
    return result;
}

TEST(selftest_of_good_chips_passes_and_measures_their_gain)
{
    rig_begin_streaming(1);
    rig.emulation.chips[0][2].gain_error[0] = 0.05;
    const uint8_t *result = run_selftest(9);
    for (int i = 0; i < 4; i++)
        CHECK_EQUAL(result[4 + 13 * i], SENSOR_OK);
    CHECK_BETWEEN(counts_at(result, 0, 0), 451, 453); // 1.16 G × 390 LSB/G
    CHECK_BETWEEN(counts_at(result, 0, 2), 420, 422); // 1.08 G
    CHECK_BETWEEN(counts_at(result, 0, 3), -453, -451);
    CHECK_BETWEEN(counts_at(result, 2, 0), 474, 476); // 5 % more
}

TEST(selftest_passes_where_the_chip_leaves_the_external_field_in)
{
    rig_begin_streaming(1);
    for (int i = 0; i < 4; i++)
        rig.emulation.chips[0][i].strap_leaves_external = true;
    rig.emulation.chips[0][0].field_ut[0] = 200;
    const uint8_t *result = run_selftest(9);
    CHECK_EQUAL(result[4], SENSOR_OK);
    CHECK_BETWEEN(counts_at(result, 0, 0), 451, 453);
    CHECK_BETWEEN(counts_at(result, 0, 3), -453, -451);
}

TEST(selftest_names_what_is_wrong_with_each_sensor)
{
    rig_begin(1);
    bench_plug_chip(&rig.emulation.chips[0][2], false);
    rig_run_ms(500);
    rig.emulation.chips[0][0].strap_gauss[1] = 0.3;
    rig.emulation.chips[0][1].saturated_axes = 1;
    const uint8_t *result = run_selftest(9);
    CHECK_EQUAL(result[4], SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(result[4 + 13], SENSOR_SELFTEST_FAILED);
    CHECK_EQUAL(counts_at(result, 1, 0), -4096);
    CHECK_EQUAL(counts_at(result, 1, 3), -4096);
    CHECK_EQUAL(result[4 + 26], SENSOR_NO_ANSWER);
    CHECK_EQUAL(counts_at(result, 2, 0), 0);
    CHECK_EQUAL(result[4 + 39], SENSOR_OK);
}

TEST(selftest_goes_on_when_a_sensor_drops_out_in_its_midst)
{
    static const struct {
        enum sensor_state state;
        int fault;
    } faults[] = {{SENSOR_NO_ANSWER, 0}, {SENSOR_NO_NEW_DATA, 1}, {SENSOR_CONFIG_NOT_HELD, 2}};
    for (int f = 0; f < 3; f++) {
        rig_begin_streaming(1);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 1, 0, 0), RESULT_DONE);
        rig_run_ms(30);
        struct emulated_chip *chip = &rig.emulation.chips[0][1];
        if (faults[f].fault == 0)
            bench_plug_chip(chip, false);
        chip->clock_stopped = faults[f].fault == 1;
        chip->config_read_only = faults[f].fault == 2;
        rig_run_ms(300);
        const uint8_t *result = rig_next(WIRE_SELFTEST);
        CHECK_EQUAL(result[4 + 13], faults[f].state);
        CHECK_EQUAL(result[4], SENSOR_OK);
        CHECK_EQUAL(result[4 + 39], SENSOR_OK);
    }
}

TEST(selftest_without_switch_or_bus_says_so)
{
    rig_begin_streaming(1);
    rig_ask(WIRE_REQUEST_SELFTEST, 1, 0, 0);
    rig_run_ms(30);
    bench_plug_switch(rig.emulation.switches[0], false);
    rig_run_ms(300);
    CHECK_EQUAL(rig_next(WIRE_SELFTEST)[4], SENSOR_MUX_NO_ANSWER);
    rig_begin_streaming(1);
    rig_ask(WIRE_REQUEST_SELFTEST, 1, 0, 0);
    rig_run_ms(30);
    rig.emulation.bench.lines[0].stuck_for_good = true;
    rig_run_ms(300);
    CHECK_EQUAL(rig_next(WIRE_SELFTEST)[4], SENSOR_BUS_STUCK);
}

TEST(selftest_of_one_pad_pauses_that_pad_and_no_other)
{
    rig_begin_streaming(2);
    rig_ask(WIRE_REQUEST_SELFTEST, 1, 0, 0);
    rig_run_ms(10);
    rig_forget();
    rig_run_ms(120);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        CHECK_EQUAL(rig_sample(packet).pad_index, 1);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 25, 28);
    rig_run_ms(300);
    rig_forget();
    rig_run_ms(50);
    struct sample_view view = rig_sample(rig_next(WIRE_SAMPLE));
    CHECK_EQUAL(view.pad_index, 0);
    CHECK_EQUAL(view.valid, 15);
    CHECK_EQUAL(view.counts[0][0], 66); // in the stream's own range again
}

TEST(selftest_of_all_pads_answers_one_packet_a_pad)
{
    rig_begin_streaming(3);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 5, 255, 0), RESULT_DONE);
    rig_run_ms(1000);
    for (int pad = 0; pad < 3; pad++)
        CHECK_EQUAL(rig_next(WIRE_SELFTEST)[2] & 15, pad);
}

TEST(selftest_works_with_simultaneous_triggers)
{
    rig_begin_streaming(1);
    rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, 1);
    rig_run_ms(100);
    CHECK_EQUAL(run_selftest(9)[4], SENSOR_OK);
    rig_run_ms(100);
    rig_forget();
    rig_run_ms(50);
    CHECK_EQUAL(rig_sample(rig_next(WIRE_SAMPLE)).valid, 15);
}

TEST(other_requests_are_busy_during_a_selftest_and_its_repeat_is_not)
{
    rig_begin_streaming(1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 5, 0, 0), RESULT_DONE);
    rig_run_ms(50);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 5, 0, 0), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 6, 0, 0), RESULT_BUSY);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 7, 255, 2), RESULT_BUSY);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 8, 255, 0), RESULT_DONE);
    rig_run_ms(300);
    CHECK_EQUAL(rig_count(WIRE_SELFTEST), 1);
}

TEST(repeated_selftest_is_answered_from_the_last_result_for_a_while)
{
    uint8_t first[4 + 13 * 4], again[4 + 13 * 4];
    rig_begin_streaming(1);
    memcpy(first, run_selftest(5), sizeof first);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 5, 0, 0), RESULT_DONE);
    memcpy(again, rig_next(WIRE_SELFTEST), sizeof again); // at once
    CHECK(memcmp(first, again, sizeof first) == 0);
    rig_run_ms(6000);
    rig_forget();
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 5, 0, 0), RESULT_DONE);
    CHECK_EQUAL(rig_count(WIRE_SELFTEST), 0); // the number wrapped around: this is a new one
    rig_run_ms(300);
    CHECK_EQUAL(rig_count(WIRE_SELFTEST), 1);
}
