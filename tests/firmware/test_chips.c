// How a board with each kind of chip appears to a host, in its stream.
#include <math.h>
#include <string.h>

#include "chip_rig.h"
#include "harness.h"

static void is_found_and_named(const struct promised *kind)
{
    chip_rig_begin(kind, 1);
    rig_run_ms(250);
    const uint8_t *hello = rig_next(WIRE_HELLO);
    for (int i = 0; i < 4; i++) {
        CHECK_EQUAL(hello[25 + 5 * i + 1], SENSOR_OK);
        for (int byte = 0; byte < 3; byte++)
            CHECK_EQUAL(hello[25 + 5 * i + 2 + byte] & kind->identification_mask[byte], kind->identification[byte]);
    }
    rig_run_ms(300);
    CHECK_EQUAL(chip_rig_newest().valid, 15);
    CHECK_EQUAL(rig_status_u32(0, 2), 0);
}
TEST_EACH_CHIP(is_found_and_named)

static void has_the_data_sheets_scale_and_sign(const struct promised *kind)
{
    for (uint16_t gain_code = 0; gain_code < kind->gain_codes; gain_code++) {
        chip_rig_begin_streaming(kind, gain_code, 150);
        rig_run_ms(50);
        struct sample_view view = chip_rig_newest();
        CHECK_EQUAL(view.valid, 15);
        CHECK_EQUAL(view.gain_code, gain_code);
        for (int i = 0; i < 4; i++)
            chip_rig_check_counts(kind, &view, i);
    }
}
TEST_EACH_CHIP(has_the_data_sheets_scale_and_sign)

static void tells_fields_up_to_its_range(const struct promised *kind)
{
    for (uint16_t gain_code = 0; gain_code < kind->gain_codes; gain_code++) {
        double most = kind->range_gauss[gain_code], rest = kind->film_gauss > 0 ? 0.1 : most;
        chip_rig_begin_streaming(kind, gain_code, 100);
        chip_rig_set_field(0, most, -rest, rest);
        chip_rig_set_field(1, -rest, most, -rest);
        chip_rig_set_field(2, rest, -rest, -most);
        rig_run_ms(100);
        struct sample_view view = chip_rig_newest();
        chip_rig_check_counts(kind, &view, 0);
        chip_rig_check_counts(kind, &view, 1);
        chip_rig_check_counts(kind, &view, 2);
    }
}
TEST_EACH_CHIP(tells_fields_up_to_its_range)

// For a chip with a film all axes are marked: a field beyond its range may have upset the film.
static void check_only_this_axis_is_marked(const struct promised *kind, const struct sample_view *view, int sensor, int axis)
{
    for (int i = 0; i < 4; i++)
        for (int a = 0; a < 3; a++)
            CHECK_EQUAL(view->counts[i][a] == INT16_MIN, i == sensor && (a == axis || kind->film_gauss > 0));
}

static void marks_a_saturated_axis_alone_and_forgets_it(const struct promised *kind)
{
    static const double factors[] = {1, -1, 1.5, -1.5, 2, -2, 3.9, -3.9};
    for (uint16_t gain_code = 0; gain_code < kind->gain_codes; gain_code++) {
        chip_rig_begin_streaming(kind, gain_code, 100);
        for (int axis = 0; axis < 3; axis++) {
            for (size_t f = 0; f < sizeof factors / sizeof *factors; f++) {
                double field[3] = {0.1, 0.1, 0.1};
                // z of the MLX90393 is coarser, so that its range is larger.
                double coarser = kind->counts_per_gauss[gain_code][0] / fabs(kind->counts_per_gauss[gain_code][axis]);
                field[axis] = factors[f] * kind->beyond * kind->range_gauss[gain_code] * coarser;
                chip_rig_set_field(2, field[0], field[1], field[2]);
                rig_run_ms(100);
                struct sample_view view = chip_rig_newest();
                CHECK_EQUAL(view.valid, 15);
                check_only_this_axis_is_marked(kind, &view, 2, axis);
                chip_rig_set_field(2, 0.75, -1.5, 0.3);
                rig_run_ms(100);
                view = chip_rig_newest();
                chip_rig_check_counts(kind, &view, 2); // nothing is left of it
            }
        }
    }
}
TEST_EACH_CHIP(marks_a_saturated_axis_alone_and_forgets_it)

static void converts_at_the_slowest_rate_that_suffices(const struct promised *kind)
{
    for (int s = 0; s < SPEEDS_MAX; s++) {
        chip_rig_begin_streaming(kind, 0, (uint16_t)kind->speeds[s].frames_hz);
        chip_rig_settle();
        uint64_t before[4];
        for (int i = 0; i < 4; i++)
            before[i] = others[0][i].common.conversions;
        rig_run_ms(2000);
        chip_rig_settle();
        for (int i = 0; i < 4; i++) {
            double rate = kind->speeds[s].conversions_hz * (1 + others[0][i].common.ppm * 1e-6);
            double least = rate > 0 ? rate * 0.985 : 350, most = rate > 0 ? rate * 1.02 : 500; // paced: as often as the bus allows
            CHECK_BETWEEN((double)(others[0][i].common.conversions - before[i]) / 2, least, most);
        }
        CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 2 * kind->speeds[s].frames_hz - 1, 2 * kind->speeds[s].frames_hz + 1);
    }
}
TEST_EACH_CHIP(converts_at_the_slowest_rate_that_suffices)

static void gives_each_conversion_once_and_at_its_time(const struct promised *kind)
{
    uint64_t taken[4] = {0}, before[4];
    double worst_us = 0, period_us = 0;
    int frames_hz = 0;
    if (kind->speeds[0].conversions_hz == 0)
        return; // test_memsic.c: it has no period
    for (int s = 0; s < SPEEDS_MAX; s++) { // the fastest rate of frames with slow clocks
        if (kind->speeds[s].conversions_hz < kind->speeds[s].frames_hz * 1.006 &&
            kind->speeds[s].conversions_hz > kind->speeds[s].frames_hz * 0.95) {
            frames_hz = kind->speeds[s].frames_hz;
            period_us = 1e6 / kind->speeds[s].conversions_hz;
        }
    }
    chip_rig_begin_streaming(kind, 0, (uint16_t)frames_hz);
    for (int i = 0; i < 4; i++)
        others[0][i].common.ppm = -7000.0 * (i + 1);
    rig_run_ms(500);
    rig_forget();
    chip_rig_settle();
    for (int i = 0; i < 4; i++)
        before[i] = others[0][i].common.conversions;
    for (int step = 0; step < 400; step++) {
        rig_run_ms(5);
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
            struct sample_view view = rig_sample(packet);
            CHECK_EQUAL(view.valid, 15);
            for (int i = 0; i < 4; i++) {
                const struct emulated_magnetometer *chip = &others[0][i].common;
                double own_us = period_us / (1 + chip->ppm * 1e-6);
                double behind_us = (double)chip->last_conversion_ns / 1e3 - (double)(view.time_us - view.age_us[i]);
                behind_us -= kind->fills_period ? own_us / 2 : 0;
                double error_us = fabs(behind_us - own_us * round(behind_us / own_us));
                worst_us = error_us > worst_us ? error_us : worst_us;
                taken[i] += view.fresh >> i & 1;
            }
        }
        rig_forget();
    }
    chip_rig_settle();
    for (int i = 0; i < 4; i++) // one more or less may fall into the time
        CHECK_BETWEEN(taken[i], others[0][i].common.conversions - before[i] - 1,
                      others[0][i].common.conversions - before[i] + 1);
    CHECK_BETWEEN(worst_us, 1, 500);
    CHECK_EQUAL(rig.emulation.device.sampler.pads[0].bus_errors, 0);
}
TEST_EACH_CHIP(gives_each_conversion_once_and_at_its_time)

static void gives_every_frame_a_new_sample_where_it_is_fast_enough(const struct promised *kind)
{
    int frames_hz = kind->speeds[SPEEDS_MAX - 1].frames_hz, seen = 0;
    chip_rig_begin_streaming(kind, 0, (uint16_t)frames_hz);
    for (int i = 0; i < 4; i++)
        others[0][i].common.ppm = 5000.0 * (i + 1);
    rig_run_ms(1000);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        seen += rig_sample(packet).fresh == 15;
    double fastest = kind->speeds[SPEEDS_MAX - 1].conversions_hz; // QST's chips have no more than 200 Hz
    CHECK_BETWEEN(seen, (fastest > 0 && fastest < frames_hz ? 0.6 : 0.97) * frames_hz, frames_hz + 1);
}
TEST_EACH_CHIP(gives_every_frame_a_new_sample_where_it_is_fast_enough)

static void has_its_thermometers_temperature(const struct promised *kind)
{
    static const double temperatures[] = {-10, 25, 60};
    for (int t = 0; t < 3; t++) {
        chip_rig_begin(kind, 1);
        for (int i = 0; i < 4; i++)
            others[0][i].common.temperature_c = temperatures[t];
        rig_run_ms(1000);
        struct sample_view view = chip_rig_newest();
        double due = kind->raw_at_25 + (temperatures[t] - 25) * kind->raw_per_kelvin;
        if (kind->raw_per_kelvin == 0)
            CHECK_EQUAL(view.temperature_raw, WIRE_TEMPERATURE_UNKNOWN);
        else
            CHECK_BETWEEN(view.temperature_raw, due - 0.6, due + 0.6);
    }
}
TEST_EACH_CHIP(has_its_thermometers_temperature)

static void tells_what_a_warmer_chip_senses(const struct promised *kind)
{
    // Large, because a coarse step could hide the difference.
    double gauss = 0.9 * (kind->film_gauss > 0 ? kind->film_gauss / sqrt(3) : kind->range_gauss[0]);
    chip_rig_begin(kind, 1);
    for (int i = 0; i < 4; i++)
        chip_rig_set_field(i, gauss, -gauss, gauss);
    rig_run_ms(1000);
    struct sample_view cold = chip_rig_newest();
    for (int i = 0; i < 4; i++)
        others[0][i].common.temperature_c = 65.0;
    rig_run_ms(1000);
    struct sample_view warm = chip_rig_newest();
    for (int i = 0; i < 4; i++)
        for (int axis = 0; axis < 3; axis++) {
            double due = cold.counts[i][axis] * (1.0 + 40.0 * kind->sensitivity_per_k);
            CHECK_BETWEEN(warm.counts[i][axis], due - 1.5, due + 1.5); // each is rounded, and the MMC5983MA's cut off
        }
}
TEST_EACH_CHIP(tells_what_a_warmer_chip_senses)

static void keeps_its_rate_beside_another_pad_of_hmc5983(const struct promised *kind)
{
    int whole[2] = {0};
    chip_rig_begin(kind, 2);
    for (int i = 0; i < 4; i++)
        rig.emulation.switches[1]->chips[i] = &rig.emulation.chips[1][i].part;
    rig_run_ms(500);
    rig_forget();
    rig_run_ms(1000);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        whole[packet[1] & 15] += rig_sample(packet).valid == 15;
    CHECK_BETWEEN(whole[0], 219, 221);
    CHECK_BETWEEN(whole[1], 219, 221);
}
TEST_EACH_CHIP(keeps_its_rate_beside_another_pad_of_hmc5983)
