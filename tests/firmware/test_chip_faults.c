// How a board appears to a host whose chips, of each kind, fail, are reset, or are triggered at once.
#include <math.h>
#include <string.h>

#include "../../firmware/core/chips/chip.h"
#include "chip_rig.h"
#include "harness.h"

static struct emulated_magnetometer *chip(int sensor)
{
    return &others[0][sensor].common;
}

static void is_set_up_again_after_a_reset_and_gives_no_wrong_number(const struct promised *kind)
{
    uint16_t gain_code = (uint16_t)(kind->gain_codes - 1);
    chip_rig_begin_streaming(kind, gain_code, 100);
    for (int trial = 0; trial < 8; trial++) {
        rig_run_ms(101.7);
        rig_forget();
        chip(1)->part.kind->power_on(&chip(1)->part);
        rig_run_ms(700);
        int frames = 0, whole = 0;
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
            struct sample_view view = rig_sample(packet);
            for (int i = 0; i < 4; i++)
                if (view.valid >> i & 1)
                    chip_rig_check_counts(kind, &view, i);
            whole = view.valid == 15 ? whole + 1 : 0;
        }
        CHECK_BETWEEN(frames, 69, 71);
        CHECK(whole > 10);
    }
}
TEST_EACH_CHIP(is_set_up_again_after_a_reset_and_gives_no_wrong_number)

static void is_set_up_while_it_measures_already(const struct promised *kind)
{
    uint16_t gain_code = (uint16_t)(kind->gain_codes - 1);
    chip_rig_begin_streaming(kind, gain_code, 100);
    emulation_reset(&rig.emulation); // the board alone: its chips continue to measure
    rig_run_ms(250);
    const uint8_t *hello = rig_next(WIRE_HELLO);
    for (int i = 0; i < 4; i++)
        CHECK_EQUAL(hello[25 + 5 * i + 1], SENSOR_OK);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 1, 255, gain_code), RESULT_DONE);
    rig_run_ms(300);
    struct sample_view view = chip_rig_newest();
    CHECK_EQUAL(view.valid, 15);
    chip_rig_check_counts(kind, &view, 3);
}
TEST_EACH_CHIP(is_set_up_while_it_measures_already)

static void is_missed_alone_and_found_again(const struct promised *kind)
{
    chip_rig_begin_streaming(kind, 0, 100);
    bench_plug_part(&chip(1)->part, false);
    rig_run_ms(200);
    rig_forget();
    rig_run_ms(1100);
    CHECK_EQUAL(rig_state(0, 1), SENSOR_NO_ANSWER);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        CHECK_EQUAL(rig_sample(packet).valid, 13);
    bench_plug_part(&chip(1)->part, true);
    rig_run_ms(1100);
    struct sample_view view = chip_rig_newest();
    CHECK_EQUAL(view.valid, 15);
    chip_rig_check_counts(kind, &view, 1);
}
TEST_EACH_CHIP(is_missed_alone_and_found_again)

static void is_noticed_when_its_clock_stops(const struct promised *kind)
{
    for (uint16_t trigger = 0; trigger < (kind->single_max_hz ? 2 : 1); trigger++) {
        chip_rig_begin_streaming(kind, 0, 50);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, trigger), RESULT_DONE);
        rig_run_ms(300);
        chip(2)->clock_stopped = true;
        rig_run_ms(300);
        CHECK_EQUAL(rig_state(0, 2), SENSOR_NO_NEW_DATA);
        CHECK_EQUAL(rig_state(0, 1), SENSOR_OK);
        chip(2)->clock_stopped = false;
        rig_run_ms(2000);
        CHECK_EQUAL(chip_rig_newest().valid, 15);
    }
}
TEST_EACH_CHIP(is_noticed_when_its_clock_stops)

static void takes_the_place_of_an_hmc5983_and_gives_it_back(const struct promised *kind)
{
    chip_rig_begin_streaming(kind, 0, 100);
    rig.emulation.switches[0]->chips[1] = &rig.emulation.chips[0][1].part;
    rig_run_ms(1000);
    CHECK_EQUAL(chip_rig_newest().valid, 15);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, 0), RESULT_DONE);
    CHECK(memcmp(rig_next(WIRE_HELLO) + 25 + 5 + 2, "H43", 3) == 0);
    rig.emulation.switches[0]->chips[1] = &chip(1)->part;
    chip(1)->part.kind->power_on(&chip(1)->part);
    rig_run_ms(1000);
    CHECK_EQUAL(chip_rig_newest().valid, 15);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, 0), RESULT_DONE);
    const uint8_t *identification = rig_next(WIRE_HELLO) + 25 + 5 + 2;
    for (int byte = 0; byte < 3; byte++)
        CHECK_EQUAL(identification[byte] & kind->identification_mask[byte], kind->identification[byte]);
}
TEST_EACH_CHIP(takes_the_place_of_an_hmc5983_and_gives_it_back)

static void check_that_it_refuses_triggers(const struct promised *kind)
{
    chip_rig_begin_streaming(kind, 0, 100);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, 1), RESULT_DONE);
    rig_run_ms(300);
    for (int i = 0; i < 4; i++)
        CHECK_EQUAL(rig_state(0, i), SENSOR_CONFIG_NOT_HELD);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 4, 255, 0), RESULT_DONE);
    rig_run_ms(1500);
    CHECK_EQUAL(chip_rig_newest().valid, 15);
}

static void measures_once_for_each_trigger(const struct promised *kind)
{
    if (!kind->single_max_hz) {
        check_that_it_refuses_triggers(kind);
        return;
    }
    uint16_t most = (uint16_t)kind->single_max_hz;
    chip_rig_begin_streaming(kind, 0, 50);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, 1), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 4, 255, (uint16_t)(most + 1)), RESULT_OUT_OF_RANGE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 5, 255, most), RESULT_DONE);
    rig_run_ms(500);
    rig_forget();
    chip_rig_settle();
    uint64_t before = chip(0)->conversions;
    rig_run_ms(1000);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), most - 2, most + 1);
    CHECK_BETWEEN((double)(chip(0)->conversions - before), most - 2, most + 1);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.valid, 15);
        CHECK_EQUAL(view.fresh, 15);
        for (int i = 0; i < 4; i++) {
            CHECK_EQUAL(view.age_us[i], 0);
            chip_rig_check_counts(kind, &view, i);
        }
    }
    CHECK_EQUAL(rig_status_u32(0, 2), 0); // nothing was set up anew
    chip_rig_settle();
    double apart_ns = fabs((double)chip(0)->last_conversion_ns - (double)chip(2)->last_conversion_ns);
    double between_ns = fabs(1e9 / most - apart_ns); // where only one of them has converted since the last trigger
    // The slowest conversion, with clocks 4 % apart: they started at once.
    CHECK_BETWEEN(apart_ns < between_ns ? apart_ns : between_ns, 0, 0.05 * 7e6);
}
TEST_EACH_CHIP(measures_once_for_each_trigger)

static void is_free_of_a_strong_field_that_was_there_for_a_moment(const struct promised *kind)
{
    chip_rig_begin_streaming(kind, 0, 50);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, kind->single_max_hz != 0), RESULT_DONE);
    rig_run_ms(300);
    chip_rig_set_field(0, 40, 0, 0);
    rig_run_ms(200);
    chip_rig_set_field(0, 0.75, -1.5, 0.3);
    rig_run_ms(200);
    struct sample_view view = chip_rig_newest();
    chip_rig_check_counts(kind, &view, 0);
}
TEST_EACH_CHIP(is_free_of_a_strong_field_that_was_there_for_a_moment)

static void says_that_it_has_no_selftest(const struct promised *kind)
{
    chip_rig_begin_streaming(kind, 0, 100);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 9, 0, 0), RESULT_DONE);
    rig_run_ms(350);
    const uint8_t *result = rig_next(WIRE_SELFTEST);
    for (int i = 0; i < 4; i++)
        CHECK_EQUAL(result[4 + 13 * i], SENSOR_SELFTEST_FAILED);
    rig_run_ms(300);
    CHECK_EQUAL(chip_rig_newest().valid, 15);
}
TEST_EACH_CHIP(says_that_it_has_no_selftest)

static void loses_one_sample_by_one_bus_error(const struct promised *kind)
{
    for (int error = BUS_NO_ANSWER; error <= BUS_STUCK; error++) {
        chip_rig_begin_streaming(kind, 0, 100);
        for (int transfer = 0; transfer < 40; transfer++) {
            rig.emulation.bench.lines[0].fail_count = 1;
            rig.emulation.bench.lines[0].fail_result = (enum bus_result)error;
            rig_run_ms(5.3);
        }
        rig_run_ms(100);
        struct sample_view view = chip_rig_newest();
        CHECK_EQUAL(view.valid, 15);
        for (int i = 0; i < 4; i++)
            chip_rig_check_counts(kind, &view, i);
        CHECK(rig.emulation.device.sampler.pads[0].bus_errors >= 30);
        for (int i = 0; i < 4; i++)
            CHECK_EQUAL(rig.emulation.device.sampler.pads[0].sensors[i].state, SENSOR_OK);
    }
}
TEST_EACH_CHIP(loses_one_sample_by_one_bus_error)

TEST(mmc5983ma_has_lost_its_factory_settings_is_set_up_again)
{
    chip_rig_begin_streaming(&mmc5983ma, 0, 100);
    chip(3)->registers[0x08] &= (uint8_t)~0x10; // OTP_Rd_Done
    rig_run_ms(600);
    CHECK(rig.emulation.device.sampler.pads[0].config_repairs >= 1);
    CHECK_EQUAL(chip_rig_newest().valid, 15);
}

static void takes_another_rate_without_a_fault(const struct promised *kind)
{
    chip_rig_begin_streaming(kind, 0, (uint16_t)kind->speeds[0].frames_hz);
    for (int change = 0; change < 20; change++) {
        int speed = change % 2 ? 0 : SPEEDS_MAX - 1;
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 3, 255, (uint16_t)kind->speeds[speed].frames_hz), RESULT_DONE);
        rig_run_ms(speed ? 45.3 : 145.1);
        for (int i = 0; i < 4; i++)
            CHECK_EQUAL(rig.emulation.device.sampler.pads[0].sensors[i].state, SENSOR_OK);
        struct sample_view view = chip_rig_newest();
        CHECK_EQUAL(view.valid, 15);
        for (int i = 0; i < 4; i++)
            chip_rig_check_counts(kind, &view, i);
    }
    CHECK_EQUAL(rig.emulation.device.sampler.pads[0].config_repairs, 0);
}
TEST_EACH_CHIP(takes_another_rate_without_a_fault)
