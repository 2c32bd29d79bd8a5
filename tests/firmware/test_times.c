// How accurate the times in the stream are.
#include <math.h>

#include "harness.h"
#include "rig.h"

// The difference between each new sample's time and the chip's true conversions, in µs; the age is the host's only
// clue.
static double worst_and_mean_age_error(double *mean)
{
    double worst = 0, sum = 0;
    int samples = 0;
    rig_run_ms(1000);
    for (int trial = 0; trial < 500; trial++) {
        rig_forget();
        rig_run_ms(5);
        const uint8_t *packet = rig_find(WIRE_SAMPLE);
        for (int i = 0; packet && i < 4; i++) {
            struct sample_view view = rig_sample(packet);
            const struct emulated_chip *chip = &rig.emulation.chips[view.pad_index][i];
            double period_us = 1e6 / 220 / (1 + chip->ppm * 1e-6);
            double behind_us = (double)chip->last_conversion_ns / 1e3 - (double)(view.time_us - view.age_us[i]);
            double error_us = fabs(behind_us - period_us * round(behind_us / period_us));
            if (!(view.fresh >> i & 1))
                continue;
            worst = error_us > worst ? error_us : worst;
            sum += error_us;
            samples++;
        }
    }
    CHECK(samples > 1500);
    *mean = sum / samples;
    return worst;
}

TEST(sample_times_are_those_of_the_chips_own_conversions)
{
    double mean;
    rig_begin(1);
    double worst = worst_and_mean_age_error(&mean);
    // A poll takes 0.15 ms, with another sensor's turn in between 0.5 ms. Without any knowledge it is 1.1 ms on
    // average.
    CHECK_BETWEEN(mean, 0, 50);
    CHECK_BETWEEN(worst, 0, 500);
}

TEST(ready_that_survives_a_read_makes_neither_duplicates_nor_wrong_times)
{
    double mean;
    rig_begin(1);
    for (int i = 0; i < 4; i++) {
        rig.emulation.chips[0][i].ready_survives_reading = true;
        rig.emulation.chips[0][i].noise_ut = 0.2;
    }
    worst_and_mean_age_error(&mean);
    CHECK_BETWEEN(mean, 0, 500);
    uint64_t before = rig.emulation.chips[0][0].conversions;
    int fresh = 0;
    rig_forget();
    rig_run_ms(5000);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        fresh += rig_sample(packet).fresh & 1;
    CHECK_BETWEEN(fresh, 0.95 * 5 * 220, (double)(rig.emulation.chips[0][0].conversions - before) + 1);
}

TEST(fresh_bit_says_that_a_sample_was_not_delivered_before)
{
    rig_begin(1);
    rig.emulation.chips[0][2].ppm = -30000; // 213.4 Hz: some frames contain no new sample of it
    rig_run_ms(500);
    rig_forget();
    rig_run_ms(10000);
    int fresh = 0, frames = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++)
        fresh += rig_sample(packet).fresh >> 2 & 1;
    CHECK_BETWEEN(fresh, 2134 - 45, 2134 + 3);
    CHECK(frames > fresh + 50);
}

TEST(time_runs_on_over_several_wraps_of_the_32_bit_counter)
{
    rig_begin(1);
    rig_run_ms(300);
    uint64_t expected_us = rig.emulation.bench.now_ns / 1000;
    for (int wrap = 0; wrap < 12; wrap++) {
        emulation_jump(&rig.emulation, 3000000000U);
        rig_forget();
        rig_run_ms(100);
        expected_us = rig.emulation.bench.now_ns / 1000;
        struct sample_view last = {.time_us = 0};
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
            struct sample_view view = rig_sample(packet);
            CHECK(last.time_us == 0 || (view.time_us >= last.time_us && view.sequence == last.sequence + 1));
            last = view;
        }
        CHECK_EQUAL(last.valid, 15);
        CHECK_BETWEEN(last.time_us, (double)expected_us - 12000, (double)expected_us);
        CHECK_EQUAL(rig_state(0, 0), SENSOR_OK);
    }
    CHECK(expected_us > 8 * (UINT64_C(1) << 32));
}

TEST(counter_that_wraps_during_the_stream_leaves_no_mark)
{
    rig_begin(1);
    rig.emulation.bench.counter_at_reset = UINT32_MAX - 1000000;
    device_init(&rig.emulation.device, &rig.emulation.board);
    rig_run_ms(3000);
    uint64_t last_us = 0;
    int frames = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
        struct sample_view view = rig_sample(packet);
        CHECK(frames < 4 || (view.time_us - last_us < 10000 && view.valid == 15));
        last_us = view.time_us;
    }
    CHECK(last_us > UINT32_MAX);
    CHECK(frames > 600);
}
