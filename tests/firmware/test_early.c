// Samples that come one by one, before their frames.
#include <string.h>

#include "../../firmware/core/hmc5983.h"
#include "harness.h"
#include "rig.h"

struct early_view {
    uint8_t pad_index, sensor, gain_code;
    uint64_t time_us;
    int16_t counts[3];
};

static struct early_view early_of(const uint8_t *packet)
{
    struct early_view view = {.pad_index = packet[1] & 15, .sensor = packet[1] >> 4 & 7, .gain_code = packet[2]};
    CHECK_EQUAL(packet[1] >> 7, 1);
    for (int i = 0; i < 6; i++)
        view.time_us |= (uint64_t)packet[3 + i] << (8 * i);
    for (int axis = 0; axis < 3; axis++)
        view.counts[axis] = (int16_t)(packet[9 + 2 * axis] | packet[10 + 2 * axis] << 8);
    return view;
}

static void begin_early(uint8_t pads, uint16_t which)
{
    rig_begin_streaming(pads);
    for (int p = 0; p < pads; p++)
        for (int i = 0; i < PAD_SENSORS_FOUND; i++)
            rig.emulation.chips[p][i].noise_ut = 0.2;
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 1, 255, which), RESULT_DONE);
    rig_run_ms(50);
    rig_forget();
}

static int early_count(int pad)
{
    int count = 0;
    for (int i = 0; i < rig.count; i++)
        count += rig.packets[i].bytes[0] == (0x10 | WIRE_EARLY) && (rig.packets[i].bytes[1] & 15) == pad;
    return count;
}

TEST(every_new_sample_of_a_frame_came_once_before_it)
{
    struct early_view last[4] = {{0}};
    int frames = 0;
    begin_early(1, 1);
    rig_run_ms(5000);
    for (int at = 0; at < rig.count; at++) {
        const uint8_t *bytes = rig.packets[at].bytes;
        if (bytes[0] == (0x10 | WIRE_EARLY)) {
            struct early_view early = early_of(bytes);
            CHECK(early.time_us > last[early.sensor].time_us);
            CHECK_EQUAL(early.gain_code, 3);
            last[early.sensor] = early;
        } else if (bytes[0] == (0x10 | WIRE_SAMPLE)) {
            struct sample_view frame = rig_sample(bytes);
            frames++;
            for (int i = 0; i < 4 && at > 8; i++) {
                CHECK_EQUAL(frame.time_us - frame.age_us[i], last[i].time_us);
                CHECK(memcmp(frame.counts[i], last[i].counts, sizeof last[i].counts) == 0);
            }
        }
    }
    CHECK_BETWEEN(frames, 1099, 1101);
    CHECK_BETWEEN(early_count(0), 4 * 1100 - 60, 4 * 1100 + 60); // chips are off by up to 1.2 %
}

TEST(only_the_pads_that_are_asked_for_send_early)
{
    begin_early(3, 4);
    rig_run_ms(1000);
    CHECK_EQUAL(early_count(0), 0);
    CHECK_EQUAL(early_count(1), 0);
    CHECK_BETWEEN(early_count(2), 850, 910);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 657, 663);
}

TEST(three_pads_send_every_sample_early)
{
    begin_early(3, 7);
    rig_run_ms(1000);
    for (int pad = 0; pad < 3; pad++)
        CHECK_BETWEEN(early_count(pad), 820, 910);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 657, 663);
}

TEST(a_host_that_asks_who_is_there_gets_frames_only_until_it_asks_for_more)
{
    begin_early(1, 1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, 0), RESULT_DONE);
    CHECK_EQUAL(rig_next(WIRE_HELLO)[20] >> 5 & 1, 1);
    rig_forget();
    rig_run_ms(100);
    CHECK_EQUAL(rig_count(WIRE_EARLY), 0);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 21, 23);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 3, 255, 1), RESULT_DONE);
    rig_forget();
    rig_run_ms(100);
    CHECK_BETWEEN(rig_count(WIRE_EARLY), 80, 96);
}

TEST(nothing_comes_early_from_a_stopped_board_nor_with_a_simultaneous_trigger)
{
    begin_early(1, 1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_STOP, 2, 255, 0), RESULT_DONE);
    rig_forget();
    rig_run_ms(100);
    CHECK_EQUAL(rig_count(WIRE_EARLY), 0);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, 1), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 4, 255, 1), RESULT_DONE);
    rig_forget();
    rig_run_ms(200);
    CHECK_EQUAL(rig_count(WIRE_EARLY), 0);
    CHECK(rig_count(WIRE_SAMPLE) > 25);
}

TEST(an_early_sample_has_the_range_that_it_was_measured_with)
{
    begin_early(1, 1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 2, 255, 6), RESULT_DONE);
    rig_forget();
    rig_run_ms(100);
    CHECK(rig_count(WIRE_EARLY) > 60);
    for (const uint8_t *packet; (packet = rig_find(WIRE_EARLY)) != NULL;) {
        struct early_view early = early_of(packet);
        CHECK_EQUAL(early.gain_code, 6);
        double field_ut = 30.0 + early.sensor;
        CHECK_BETWEEN(early.counts[2], (field_ut - 2) / 100 * hmc5983_lsb_per_gauss[6],
                      (field_ut + 2) / 100 * hmc5983_lsb_per_gauss[6]);
    }
}
