// A mux with chips on all its channels: two pads of four, until a host asks for one of eight.
#include <math.h>
#include <string.h>

#include "../../firmware/core/hmc5983.h"
#include "chip_rig.h"
#include "harness.h"

enum { EIGHT = 0x8, EIGHT_AND_FOUR = 0x48, ALL = 0xFF };

static double field_ut(int sensor, int axis)
{
    return 10.0 * (axis + 1) + sensor;
}

// Switch 0 has eight chips, the others four. No noise.
static void begin(uint8_t switches)
{
    rig_begin(switches);
    emulation_fill_switch(&rig.emulation);
    for (int i = 0; i < PAD_SENSORS_MAX; i++) {
        rig.emulation.chips[0][i].noise_ut = 0;
        for (int axis = 0; axis < 3; axis++)
            rig.emulation.chips[0][i].field_ut[axis] = field_ut(i, axis);
    }
    rig_run_ms(300);
}

static void make_one(uint8_t switches)
{
    begin(switches);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, EIGHT), RESULT_DONE);
    rig_run_ms(500);
    rig_forget();
}

// In the next hello: a digit for each pad.
static int sensor_counts(void)
{
    const uint8_t *hello = rig_next(WIRE_HELLO), *pad = hello + 22;
    int counts = 0;
    for (int p = 0; p < hello[21]; p++, pad += 3 + 5 * pad[2])
        counts = 10 * counts + pad[2];
    return counts;
}

static int ask_counts(void)
{
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 99, 255, 0), RESULT_DONE);
    return sensor_counts();
}

static void check_counts(const struct sample_view *view)
{
    for (int i = 0; i < 8; i++)
        for (int axis = 0; axis < 3; axis++)
            CHECK_EQUAL(view->counts[i][axis], lround(field_ut(i, axis) / 100 * hmc5983_lsb_per_gauss[view->gain_code]));
}

TEST(eight_sensors_are_two_pads_until_a_host_asks_for_one)
{
    begin(2);
    CHECK_EQUAL(sensor_counts(), 444);
    uint64_t before_us = rig_sample(rig_next(WIRE_SAMPLE)).time_us;
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, EIGHT), RESULT_DONE);
    rig_run_ms(300);
    // The hello comes after every sensor was tried, and before the first sample.
    CHECK_EQUAL(rig.packets[rig.read].bytes[0], 0x10 | WIRE_HELLO);
    const uint8_t *hello = rig.packets[rig.read].bytes;
    CHECK_EQUAL(sensor_counts(), 84);
    for (int i = 0; i < 8; i++) {
        CHECK_EQUAL(hello[25 + 5 * i], i);
        CHECK_EQUAL(hello[25 + 5 * i + 1], SENSOR_OK);
    }
    CHECK_EQUAL(hello[25 + 40 + 1], 0x71);
    CHECK_EQUAL(rig.packets[rig.read].bytes[0], 0x10 | WIRE_STATUS);
    struct sample_view view = rig_sample(rig_next(WIRE_SAMPLE));
    CHECK_EQUAL(view.sensor_count, 8);
    CHECK_EQUAL(view.sequence, 0);
    CHECK(view.time_us > before_us); // time goes on
}

static void check_stream(uint8_t switches, double least_fresh)
{
    int frames[2] = {0}, fresh = 0;
    make_one(switches);
    rig_run_ms(5000);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.sensor_count, view.pad_index ? 4 : 8);
        CHECK_EQUAL(view.valid, view.pad_index ? 15 : ALL);
        if (view.pad_index == 0)
            check_counts(&view);
        for (int i = 0; i < 8 && view.pad_index == 0; i++)
            fresh += view.fresh >> i & 1;
        frames[view.pad_index]++;
    }
    CHECK_BETWEEN(frames[0], 1099, 1101);
    if (switches > 1)
        CHECK_BETWEEN(frames[1], 1099, 1101);
    CHECK_BETWEEN(fresh / (8.0 * frames[0]), least_fresh, 1);
}

TEST(pad_of_eight_streams_220_frames_a_second)
{
    check_stream(1, 0.985); // clocks are slower than the frames by up to 1.2 %
}

TEST(pad_of_eight_streams_220_frames_a_second_beside_a_pad_of_four)
{
    check_stream(2, 0.9); // the bus is 95 % busy: a few conversions come a frame late
}

TEST(pad_of_eight_is_triggered_at_once)
{
    make_one(2);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 2, 255, TRIGGER_SIMULTANEOUS), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 3, 255, 152), RESULT_DONE);
    rig_run_ms(200);
    rig_forget();
    rig_run_ms(5000);
    int frames = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        if (view.pad_index)
            continue;
        CHECK_EQUAL(view.valid, ALL);
        CHECK_EQUAL(view.fresh, ALL);
        check_counts(&view);
        frames++;
    }
    CHECK_BETWEEN(frames, 758, 761);
}

TEST(selftest_measures_all_eight)
{
    make_one(1);
    rig.emulation.chips[0][7].gain_error[0] = 0.05;
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 9, 0, 0), RESULT_DONE);
    rig_run_ms(400);
    const uint8_t *result = rig_next(WIRE_SELFTEST);
    CHECK_EQUAL(result[2], 0x80);
    for (int i = 0; i < 8; i++)
        CHECK_EQUAL(result[4 + 13 * i], SENSOR_OK);
    CHECK_BETWEEN(result[4 + 13 * 7 + 1] | result[4 + 13 * 7 + 2] << 8, 474, 476); // 5 % above 1.16 G × 390 LSB/G
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 9, 0, 0), RESULT_DONE); // its reply was lost
    CHECK_EQUAL(rig_next(WIRE_SELFTEST)[2], 0x80);
}

TEST(eight_sensors_send_early)
{
    int of[8] = {0};
    make_one(1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 2, 255, 1), RESULT_DONE);
    rig_forget();
    rig_run_ms(1000);
    for (const uint8_t *packet; (packet = rig_find(WIRE_EARLY)) != NULL;)
        of[packet[1] >> 4 & 7]++;
    for (int i = 0; i < 8; i++)
        CHECK_BETWEEN(of[i], 214, 226);
}

TEST(sensor_of_the_upper_half_that_is_unplugged_is_told_and_the_others_go_on)
{
    make_one(2);
    bench_plug_chip(&rig.emulation.chips[0][6], false);
    rig_run_ms(1500);
    for (int i = 0; i < 8; i++)
        CHECK_EQUAL(rig_state(0, i), i == 6 ? SENSOR_NO_ANSWER : SENSOR_OK);
    CHECK(rig_status_u32(0, 0) >= 3);
    CHECK_EQUAL(rig_status_u32(1, 0), 0);
    const uint8_t *packet = NULL;
    for (const uint8_t *next; (next = rig_find(WIRE_SAMPLE)) != NULL;)
        packet = rig_sample(next).pad_index ? packet : next;
    CHECK_EQUAL(rig_sample(packet).valid, ALL & ~(1 << 6));
    bench_plug_chip(&rig.emulation.chips[0][6], true);
    rig_run_ms(2000);
    CHECK_EQUAL(rig_state(0, 6), SENSOR_OK);
}

TEST(pad_of_eight_outlives_a_reset_but_not_the_reset_pin)
{
    make_one(2);
    emulation_reset(&rig.emulation);
    rig_run_ms(300);
    CHECK_EQUAL(rig.packets[0].bytes[0], 0x10 | WIRE_HELLO);
    CHECK_EQUAL(sensor_counts(), 84);
    CHECK_EQUAL(rig_sample(rig_next(WIRE_SAMPLE)).sensor_count, 8);
    rig_forget();
    emulation_reset_by_pin(&rig.emulation);
    rig_run_ms(300);
    CHECK_EQUAL(sensor_counts(), 444);
}

TEST(pads_that_are_there_already_are_not_made_again)
{
    make_one(2);
    rig_run_ms(100);
    uint32_t last = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        last = rig_sample(packet).sequence;
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, EIGHT), RESULT_DONE); // its reply was lost
    CHECK_EQUAL(sensor_counts(), 84);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, EIGHT_AND_FOUR), RESULT_DONE);
    CHECK_EQUAL(sensor_counts(), 84);
    rig_run_ms(20);
    CHECK(rig_sample(rig_next(WIRE_SAMPLE)).sequence > last);
}

TEST(pads_of_four_come_back_when_asked_for)
{
    make_one(2);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, 0x444), RESULT_DONE);
    rig_run_ms(300);
    CHECK_EQUAL(sensor_counts(), 444);
    CHECK_EQUAL(rig_sample(rig_next(WIRE_SAMPLE)).sensor_count, 4);
}

TEST(pad_has_as_few_sensors_as_are_asked_for)
{
    begin(2);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, 0x36), RESULT_DONE);
    rig_run_ms(300);
    rig_forget();
    CHECK_EQUAL(ask_counts(), 63);
    rig_run_ms(1100);
    CHECK_EQUAL(rig_state(0, 5), SENSOR_OK);
    CHECK_EQUAL(rig_state(1, 2), SENSOR_OK);
    CHECK_EQUAL(rig_sample(rig_next(WIRE_SAMPLE)).valid, 0x3F);
}

TEST(pads_that_cannot_be_are_refused_and_change_nothing)
{
    static const uint16_t wrong[] = {
        0x9,    // more than a sample carries
        0x80,   // the mux belongs to the previous pad
        0x88,   // more sensors than a board keeps
        0x4448, // more pads than there are
        0x1000,
        0xFFFF,
    };
    begin(2);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, (uint8_t)i, 255, wrong[i]), RESULT_OUT_OF_RANGE);
    CHECK_EQUAL(ask_counts(), 444);
}

TEST(pad_of_eight_needs_a_mux_without_another_pad)
{
    begin(1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, 0x84), RESULT_OUT_OF_RANGE);
    CHECK_EQUAL(ask_counts(), 44);
}

TEST(pad_of_eight_needs_a_mux)
{
    rig_begin(2);
    rig.emulation.pads.found[1] = (struct pad_wiring){0, TCA9548A_NONE, PAD_SENSORS_FOUND, 12};
    emulation_reset(&rig.emulation);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, 0x84), RESULT_OUT_OF_RANGE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, EIGHT_AND_FOUR), RESULT_DONE);
}

TEST(other_pads_are_not_made_during_a_selftest)
{
    begin(1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_SELFTEST, 1, 0, 0), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, EIGHT), RESULT_BUSY);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 3, 255, 0x44), RESULT_DONE);
    rig_run_ms(400);
    CHECK_EQUAL(rig_next(WIRE_SELFTEST)[2], 0x40);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 4, 255, EIGHT), RESULT_DONE);
}

TEST(time_goes_on_beyond_32_bits_when_pads_are_made)
{
    begin(1);
    emulation_jump(&rig.emulation, 5000000000ULL);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, EIGHT), RESULT_DONE);
    rig_forget();
    rig_run_ms(300);
    CHECK_EQUAL(rig.packets[0].bytes[0], 0x10 | WIRE_HELLO);
    CHECK_EQUAL(sensor_counts(), 8);
    CHECK(rig_sample(rig_next(WIRE_SAMPLE)).time_us > 5000000000ULL);
}

TEST(pads_are_whole_only_as_they_were_sealed)
{
    struct pads pads;
    memset(&pads, 0, sizeof pads);
    pads.count = 1;
    pads.wanted = EIGHT;
    pads_seal(&pads);
    CHECK(pads_are_whole(&pads));
    pads.wanted = 0;
    CHECK(!pads_are_whole(&pads));
    pads.count = 0;
    pads_seal(&pads);
    CHECK(!pads_are_whole(&pads));
}

// Frames a second that eight of a kind sustain, with no sensor missing in any.
static void keeps_its_frames_with_eight_on_a_mux(const struct promised *kind)
{
    chip_rig_begin(kind, 1);
    chip_rig_fill_switch(kind);
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, EIGHT), RESULT_DONE);
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 2, 255, 0), RESULT_DONE);
    for (int trigger = TRIGGER_FREE; trigger <= (kind->single_max_hz ? TRIGGER_SIMULTANEOUS : TRIGGER_FREE); trigger++) {
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, (uint16_t)trigger), RESULT_DONE);
        uint16_t rate_hz = sampler_rate_max(&rig.emulation.device.sampler, (enum trigger)trigger);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 4, 255, rate_hz), RESULT_DONE);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 5, 255, (uint16_t)(rate_hz + 1)), RESULT_OUT_OF_RANGE);
        rig_run_ms(300);
        rig_forget();
        rig_run_ms(2000);
        int frames = 0;
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
            struct sample_view view = rig_sample(packet);
            CHECK_EQUAL(view.valid, ALL);
            if (trigger)
                CHECK_EQUAL(view.fresh, ALL);
            for (int i = 0; i < 8; i++)
                chip_rig_check_counts(kind, &view, i);
        }
        CHECK_BETWEEN(frames, 2 * rate_hz - 1, 2 * rate_hz + 1);
    }
}
TEST_EACH_CHIP(keeps_its_frames_with_eight_on_a_mux)
