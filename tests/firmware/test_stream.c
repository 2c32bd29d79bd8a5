// How a healthy board appears to a host.
#include <math.h>
#include <string.h>

#include "../../firmware/core/hmc5983.h"
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
    CHECK_EQUAL(hello[20], 0x73);
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
    } limits[] = {{1, 152}, {2, 152}, {3, 152}};
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

// A field that grows by 1 µT a millisecond tells when it was measured. Returns the error of a sample's time, in ms.
// That time is the middle of the chip's 6 ms; the emulated chip takes the field at their end.
static double field_clock_error_ms(const struct sample_view *view, int sensor)
{
    double field_ut = view->counts[sensor][0] * 100.0 / 660;
    double measured_ms = (double)(view->time_us - view->age_us[sensor]) / 1e3, expected_ut = fmod(measured_ms + 3, 200);
    double error = field_ut - expected_ut;
    return error > 100 ? error - 200 : error < -100 ? error + 200 : error;
}

static void run_with_a_field_that_tells_the_time(int milliseconds, bool firmware_runs)
{
    for (int i = 0; i < milliseconds; i++) {
        emulation_settle(&rig.emulation); // conversions that ended before saw the old field
        for (int sensor = 0; sensor < 4; sensor++)
            rig.emulation.chips[0][sensor].field_ut[0] = fmod((double)rig.emulation.bench.now_ns / 1e6, 200);
        if (firmware_runs)
            rig_run_ms(1);
        else
            bench_pass_time(&rig.emulation.bench, 1000000);
    }
}

TEST(samples_that_are_read_during_the_next_conversions_are_those_of_their_own_trigger)
{
    rig_begin(1);
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, 1), RESULT_DONE);
    run_with_a_field_that_tells_the_time(100, true);
    for (int trial = 0; trial < 60; trial++) {
        rig_forget();
        run_with_a_field_that_tells_the_time(50 + trial % 7, true);
        // The processor is late by about a conversion: what it reads then may belong to the next trigger.
        run_with_a_field_that_tells_the_time(5 + trial % 3, false);
        run_with_a_field_that_tells_the_time(20, true);
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
            struct sample_view view = rig_sample(packet);
            for (int i = 0; i < 4; i++) {
                if (!(view.valid >> i & 1))
                    continue;
                // The field moves in steps of a millisecond and more, and the chips' clocks differ by 0.1 ms.
                CHECK_BETWEEN(field_clock_error_ms(&view, i), -1.8, 0.3);
            }
        }
    }
}

TEST(no_conversion_of_a_chip_slower_than_the_frames_is_lost)
{
    static const double slow_ppm[4] = {-5000, -12000, -20000, -29000};
    rig_begin(1);
    for (int i = 0; i < 4; i++)
        rig.emulation.chips[0][i].ppm = slow_ppm[i];
    rig_run_ms(1000);
    rig_forget();
    uint64_t before[4];
    int fresh[4] = {0};
    for (int i = 0; i < 4; i++)
        before[i] = rig.emulation.chips[0][i].conversions;
    rig_run_ms(10000);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        for (int i = 0; i < 4; i++)
            fresh[i] += rig_sample(packet).fresh >> i & 1;
    for (int i = 0; i < 4; i++) // one may be on its way at either end
        CHECK_BETWEEN(fresh[i] - (double)(rig.emulation.chips[0][i].conversions - before[i]), -1, 1);
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
        third->chips[i] = &e->chips[2][i].part;
    e->pads.found[2].bus = 0;
    e->pads.found[2].mux_address = 0x72;
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
