// What a host sees of a healthy board.
#include <math.h>
#include <string.h>

#include "harness.h"
#include "rig.h"

static void check_counts_match_field(const struct sample_view *view)
{
    for (int i = 0; i < view->sensor_count; i++) {
        for (int axis = 0; axis < 3 && (view->valid >> i & 1); axis++) {
            double field_ut = 10.0 * (axis + 1) + i + 4 * view->pad_index;
            CHECK_EQUAL(view->counts[i][axis], lround(field_ut / 100 * hmc5983_lsb_per_gauss[view->gain_code]));
        }
    }
}

TEST(hello_and_status_come_before_the_first_sample)
{
    rig_begin(3);
    rig_run_ms(300);
    CHECK_EQUAL(rig.packets[0].bytes[0], 0x10 | WIRE_HELLO);
    CHECK_EQUAL(rig.packets[1].bytes[0], 0x10 | WIRE_STATUS);
    CHECK_EQUAL(rig.packets[2].bytes[0], 0x10 | WIRE_SAMPLE);
    const uint8_t *hello = rig_next(WIRE_HELLO);
    CHECK_EQUAL(hello[4], RESET_POWER_ON);
    CHECK_EQUAL(hello[6], 1);
    CHECK_EQUAL(hello[17], 12);
    CHECK_EQUAL(hello[18], 220);
    CHECK_EQUAL(hello[20], 0x13);
    CHECK_EQUAL(hello[21], 3);
    CHECK(memcmp(hello + 22, "\x01\x70\x04\x00\x00H43", 8) == 0);
    CHECK(memcmp(hello + 22 + 46, "\x02\x70\x04\x00\x00H43", 8) == 0);
}

TEST(every_pad_streams_220_frames_a_second_without_gaps)
{
    rig_begin(3);
    rig_run_ms(500);
    rig_forget();
    rig_run_ms(10000);
    uint32_t next[3] = {0};
    int frames[3] = {0};
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        CHECK(frames[view.pad_index] == 0 || view.sequence == next[view.pad_index]);
        CHECK_EQUAL(view.valid, 15);
        check_counts_match_field(&view);
        next[view.pad_index] = view.sequence + 1;
        frames[view.pad_index]++;
    }
    for (int pad = 0; pad < 3; pad++)
        CHECK_BETWEEN(frames[pad], 2199, 2201);
}

TEST(every_rate_is_kept)
{
    static const uint16_t rates[] = {1, 7, 100, 219};
    rig_begin(1);
    rig_run_ms(300);
    for (int i = 0; i < 4; i++) {
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, (uint8_t)i, 255, rates[i]), RESULT_DONE);
        rig_forget();
        rig_run_ms(20000);
        CHECK_BETWEEN(rig_count(WIRE_SAMPLE), rates[i] * 20 - 1, rates[i] * 20 + 1);
    }
}

TEST(rate_is_exact_although_its_period_is_no_whole_number_of_microseconds)
{
    int frames = 0;
    rig_begin(1);
    rig_run_ms(300);
    uint64_t start_ns = rig.emulation.bench.now_ns;
    for (int second = 0; second < 200; second++) {
        rig_forget();
        rig_run_ms(1000);
        frames += rig_count(WIRE_SAMPLE);
    }
    double expected = (double)(rig.emulation.bench.now_ns - start_ns) * 220e-9;
    CHECK_BETWEEN(frames, expected - 1, expected + 1); // with periods of 4545 µs it would be 4.4 more
}

TEST(no_sample_of_an_old_gain_is_ever_valid)
{
    rig_begin(1);
    rig_run_ms(300.3);
    for (int change = 0; change < 60; change++) {
        uint16_t gain_code = (uint16_t)((change * 5 + 1) % 8);
        rig_forget();
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 1, 255, gain_code), RESULT_DONE);
        rig_run_ms(40 + 0.37 * change);
        struct sample_view view = {.valid = 0};
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
            view = rig_sample(packet);
            CHECK_EQUAL(view.gain_code, gain_code);
            check_counts_match_field(&view);
        }
        CHECK_EQUAL(view.valid, 15);
    }
}

TEST(simultaneous_samples_are_of_one_trigger)
{
    rig_begin(2);
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, 1), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, 100), RESULT_DONE);
    rig_run_ms(100);
    rig_forget();
    rig_run_ms(5000);
    int frames = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.trigger, 1);
        CHECK_EQUAL(view.valid, 15);
        CHECK_EQUAL(view.fresh, 15);
        check_counts_match_field(&view);
        for (int i = 0; i < 4; i++)
            CHECK_EQUAL(view.age_us[i], 0);
    }
    CHECK_BETWEEN(frames, 998, 1002);
    // 6 ms conversions by clocks up to ±1.4 % apart.
    for (int i = 1; i < 4; i++)
        CHECK_BETWEEN(fabs((double)rig.emulation.chips[0][i].last_conversion_ns -
                           (double)rig.emulation.chips[0][0].last_conversion_ns), 0, 200e3);
}

TEST(simultaneous_reaches_the_limit_that_it_promises)
{
    static const struct {
        uint8_t pads;
        uint16_t rate_hz;
    } limits[] = {{1, 129}, {2, 109}, {3, 109}}; // the third pad is on the other port
    for (int i = 0; i < 3; i++) {
        rig_begin(limits[i].pads);
        rig_run_ms(300);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, 1), RESULT_DONE); // from 220 Hz: lowered to the limit
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, (uint16_t)(limits[i].rate_hz + 1)), RESULT_OUT_OF_RANGE);
        rig_run_ms(100);
        rig_forget();
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 3, 255, 0), RESULT_DONE);
        CHECK_EQUAL(rig_next(WIRE_HELLO)[18], limits[i].rate_hz);
        rig_run_ms(5000);
        // Emulation does one bus after the other, a little slower than two ports would.
        CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 0.97 * 5 * limits[i].rate_hz * limits[i].pads,
                      1.001 * 5 * limits[i].rate_hz * limits[i].pads + 3);
    }
}

TEST(temperature_is_the_mean_of_the_valid_sensors)
{
    rig_begin(1);
    for (int i = 0; i < 4; i++)
        rig.emulation.chips[0][i].temperature_c = 20.0 + i;
    rig_run_ms(1000);
    rig_forget();
    rig_run_ms(20);
    CHECK_EQUAL(rig_sample(rig_next(WIRE_SAMPLE)).temperature_raw, -448); // 21.5 °C
}

TEST(packets_are_dropped_whole_and_counted_when_the_line_is_full)
{
    rig_begin(1);
    rig_run_ms(500);
    struct sample_view before = {.sequence = 0};
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        before = rig_sample(packet);
    rig.line_full = true;
    rig_run_ms(100);
    rig.line_full = false;
    rig_run_ms(50);
    struct sample_view after = rig_sample(rig_next(WIRE_SAMPLE));
    CHECK_EQUAL(after.sequence - before.sequence, 23);
    rig_run_ms(1000);
    CHECK_EQUAL(rig.emulation.device.transmit_dropped, 22);
}

TEST(three_pads_on_one_bus_keep_220_frames_a_second)
{
    rig_begin(3);
    struct emulation *e = &rig.emulation;
    struct emulated_switch *third = bench_add_switch(&e->bench, 0, 0x72);
    for (int i = 0; i < 4; i++)
        third->chips[i] = &e->chips[2][i];
    e->wiring[2].bus = 0;
    e->wiring[2].mux_address = 0x72;
    device_init(&e->device, &e->board);
    rig_run_ms(500);
    rig_forget();
    rig_run_ms(5000);
    int fresh = 0, frames = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.valid, 15);
        check_counts_match_field(&view);
        for (int i = 0; i < 4; i++)
            fresh += view.fresh >> i & 1;
    }
    CHECK_BETWEEN(frames, 3297, 3303);
    CHECK_BETWEEN(fresh / (4.0 * frames), 0.9, 1); // the bus is 95 % busy: a few conversions come a frame late
}

TEST(core_for_three_pads_fits_in_two_kibibytes)
{
    CHECK_BETWEEN(sizeof(struct device), 0, 2048);
}
