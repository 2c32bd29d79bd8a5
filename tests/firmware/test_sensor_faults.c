// How a board with a broken sensor appears to a host.
#include "harness.h"
#include "rig.h"

static struct emulated_chip *chip(int sensor)
{
    return &rig.emulation.chips[0][sensor];
}

// Runs on, then checks the state of pad 0's sensor 1, and that everything else of the pad still delivers new samples.
static void check_only_sensor_1_is_lost(double ms, enum sensor_state state)
{
    rig_run_ms(ms);
    CHECK_EQUAL(rig_state(0, 1), state);
    rig_forget();
    rig_run_ms(1000);
    int frames = 0, fresh[4] = {0};
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.valid, 13);
        CHECK_EQUAL(view.age_us[1], 65535);
        CHECK_EQUAL(view.counts[1][0], 0);
        for (int i = 0; i < 4; i++)
            fresh[i] += view.fresh >> i & 1;
    }
    CHECK_BETWEEN(frames, 219, 221);
    for (int i = 0; i < 4; i++)
        CHECK(i == 1 ? fresh[i] == 0 : fresh[i] > 205);
}

static void check_sensor_1_comes_back(void)
{
    rig_run_ms(1500); // the longest back-off is 0.8 s
    rig_forget();
    rig_run_ms(1100);
    CHECK_EQUAL(rig_state(0, 1), SENSOR_OK);
    struct sample_view view = {.valid = 0};
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        view = rig_sample(packet);
    CHECK_EQUAL(view.valid, 15);
    CHECK_EQUAL(view.counts[1][0], 73); // 11 µT at 660 LSB/G
}

TEST(unplugged_sensor_does_not_stop_the_others_and_comes_back)
{
    rig_begin_streaming(1);
    bench_plug_chip(chip(1), false);
    check_only_sensor_1_is_lost(100, SENSOR_NO_ANSWER);
    CHECK(rig_status_u32(0, 0) >= 3);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 255, 0), RESULT_DONE);
    CHECK_EQUAL(rig_next(WIRE_HELLO)[25 + 5 + 2], 0); // identification: zeros where nothing answers
    bench_plug_chip(chip(1), true);
    check_sensor_1_comes_back();
}

TEST(time_does_not_run_backwards_when_the_newest_sensor_is_lost)
{
    uint64_t last_us = 0;
    rig_begin(1);
    for (int trial = 0; trial < 40; trial++) {
        struct sensor *sensors = rig.emulation.device.sampler.pads[0].sensors, *newest = sensors;
        rig_run_ms(300 + 0.47 * trial);
        for (int i = 1; i < 4; i++)
            newest = sensors[i].conversion.ended_us > newest->conversion.ended_us ? &sensors[i] : newest;
        rig_forget();
        rig.emulation.device.sampler.pads[0].frame_due = true; // one frame with it, immediately followed by one without
        device_poll(&rig.emulation.device);
        sensor_fail(newest, SENSOR_NO_ANSWER, rig.emulation.bench.now_ns / 1000);
        rig.emulation.device.sampler.pads[0].frame_due = true;
        device_poll(&rig.emulation.device);
        CHECK(rig_count(WIRE_SAMPLE) >= 2);
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
            CHECK(rig_sample(packet).time_us >= last_us);
            last_us = rig_sample(packet).time_us;
        }
    }
}

TEST(sensor_that_is_plugged_in_late_is_found)
{
    rig_begin(1);
    bench_plug_chip(chip(1), false);
    check_only_sensor_1_is_lost(20000, SENSOR_NO_ANSWER); // long enough for the back-off to have grown
    bench_plug_chip(chip(1), true);
    check_sensor_1_comes_back();
}

TEST(other_chip_in_a_sensors_place_is_not_used)
{
    rig_begin_streaming(1);
    bench_plug_chip(chip(1), false);
    bench_plug_chip(chip(1), true);
    chip(1)->identification[2] = '4';
    check_only_sensor_1_is_lost(200, SENSOR_WRONG_IDENTIFICATION);
    chip(1)->identification[2] = '3';
    check_sensor_1_comes_back();
}

TEST(chip_that_does_not_hold_its_configuration_is_not_used)
{
    rig_begin_streaming(1);
    bench_plug_chip(chip(1), false);
    bench_plug_chip(chip(1), true);
    chip(1)->config_read_only = true;
    check_only_sensor_1_is_lost(200, SENSOR_CONFIG_NOT_HELD);
    chip(1)->config_read_only = false;
    check_sensor_1_comes_back();
}

TEST(chip_whose_clock_stops_is_noticed)
{
    rig_begin_streaming(1);
    chip(1)->clock_stopped = true;
    check_only_sensor_1_is_lost(200, SENSOR_NO_NEW_DATA);
    chip(1)->clock_stopped = false;
    check_sensor_1_comes_back();
}

TEST(chip_whose_clock_stops_is_noticed_although_ready_stays_set)
{
    rig_begin_streaming(1);
    for (int i = 0; i < 4; i++) {
        chip(i)->ready_survives_reading = true;
        chip(i)->noise_ut = 1;
    }
    rig_run_ms(1000);
    chip(1)->clock_stopped = true;
    rig_run_ms(1000);
    CHECK_EQUAL(rig_state(0, 1), SENSOR_NO_NEW_DATA);
    CHECK_EQUAL(rig_state(0, 0), SENSOR_OK);
}

TEST(chip_whose_clock_stops_is_noticed_with_simultaneous_triggers)
{
    rig_begin_streaming(1);
    rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, 1);
    rig_run_ms(200);
    chip(1)->clock_stopped = true;
    rig_run_ms(300);
    CHECK_EQUAL(rig_state(0, 1), SENSOR_NO_NEW_DATA);
    rig_forget();
    rig_run_ms(1000);
    int frames = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++)
        CHECK_EQUAL(rig_sample(packet).valid, 13);
    CHECK(frames > 100);
    chip(1)->clock_stopped = false;
    rig_run_ms(2000);
    CHECK_EQUAL(rig_state(0, 1), SENSOR_OK);
}

TEST(frames_go_on_with_no_sensor_at_all)
{
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        rig_begin_streaming(1);
        rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, trigger);
        for (int i = 0; i < 4; i++)
            bench_plug_chip(chip(i), false);
        rig_run_ms(300);
        rig_forget();
        rig_run_ms(1000);
        uint64_t last_us = 0;
        int frames = 0;
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++) {
            struct sample_view view = rig_sample(packet);
            CHECK_EQUAL(view.valid, 0);
            CHECK_EQUAL(view.temperature_raw, -32768);
            CHECK(view.time_us > last_us);
            last_us = view.time_us;
        }
        CHECK_BETWEEN(frames, trigger ? 151 : 219, trigger ? 153 : 221);
    }
}

TEST(stale_lock_is_undone_without_losing_the_sensor)
{
    rig_begin_streaming(1);
    chip(1)->bytes_read = 1; // like after an aborted transfer
    chip(1)->ready = false;
    rig_run_ms(1500);
    CHECK_EQUAL(rig_state(0, 1), SENSOR_OK);
    CHECK_EQUAL(rig_status_u32(0, 0), 0);
    CHECK_EQUAL(rig_count(WIRE_STATUS), 1 + (rig_count(WIRE_STATUS) > 1)); // no change of state was reported
    rig_forget();
    rig_run_ms(100);
    CHECK_EQUAL(rig_sample(rig_next(WIRE_SAMPLE)).valid, 15);
}

TEST(corrupted_configuration_is_repaired_and_counted)
{
    rig_begin_streaming(1);
    chip(2)->config_b = 0x00; // ±0.88 G: counts twice too large
    chip(0)->config_a = 0x1C; // compensation off
    rig_run_ms(400);
    rig_forget();
    rig_run_ms(1100);
    CHECK_EQUAL(rig_status_u32(0, 2), 2);
    CHECK_EQUAL(chip(2)->config_b, 0x60);
    CHECK_EQUAL(chip(0)->config_a, 0x9C);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        CHECK_EQUAL(rig_sample(packet).counts[2][0], 79); // 12 µT
    CHECK_EQUAL(rig_state(0, 2), SENSOR_OK);
}

TEST(saturated_axis_is_passed_on_and_the_others_stay)
{
    rig_begin_streaming(1);
    chip(3)->saturated_axes = 1 << 1;
    rig_run_ms(100);
    rig_forget();
    rig_run_ms(100);
    struct sample_view view = rig_sample(rig_next(WIRE_SAMPLE));
    CHECK_EQUAL(view.counts[3][1], -4096);
    CHECK_EQUAL(view.counts[3][0], 86); // 13 µT
    CHECK_EQUAL(view.valid, 15);
    CHECK_EQUAL(view.fresh >> 3 & 1, 1);
}

TEST(status_comes_each_second_and_at_once_when_a_state_changes)
{
    rig_begin_streaming(1);
    rig_run_ms(5000);
    CHECK_EQUAL(rig_count(WIRE_STATUS), 5);
    rig_forget();
    bench_plug_chip(chip(0), false);
    uint64_t unplugged_ns = rig.emulation.bench.now_ns;
    rig_run_ms(100);
    rig_next(WIRE_STATUS);
    CHECK_BETWEEN((double)(rig.packets[rig.read - 1].at_ns - unplugged_ns) * 1e-6, 0, 20);
}
