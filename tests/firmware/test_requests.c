// Requests of the host, and the board's reaction.
#include "harness.h"
#include "rig.h"

TEST(hello_and_status_are_answered_when_asked)
{
    rig_begin_streaming(2);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 77, 255, 0), RESULT_DONE);
    CHECK_EQUAL(rig_next(WIRE_HELLO)[21], 2);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_STATUS, 78, 0, 0), RESULT_DONE);
    CHECK_EQUAL(rig_next(WIRE_STATUS)[15], 2);
}

TEST(stop_ends_the_stream_and_start_resumes_it_without_a_gap_in_the_numbers)
{
    rig_begin_streaming(1);
    rig_run_ms(100);
    uint32_t last = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        last = rig_sample(packet).sequence;
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_STOP, 1, 255, 0), RESULT_DONE);
    rig_forget();
    rig_run_ms(2000);
    CHECK_EQUAL(rig_count(WIRE_SAMPLE), 0);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 2, 255, 0), RESULT_DONE);
    CHECK_EQUAL(rig_next(WIRE_HELLO)[20] >> 4 & 1, 0);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 3, 255, 0), RESULT_DONE);
    rig_run_ms(100);
    struct sample_view view = rig_sample(rig_next(WIRE_SAMPLE));
    CHECK_EQUAL(view.sequence, last + 1);
    CHECK_EQUAL(view.valid, 15); // sensors were served all the time
}

TEST(stop_before_the_first_frame_holds)
{
    rig_begin(1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_STOP, 1, 255, 0), RESULT_DONE);
    rig_run_ms(1000);
    CHECK_EQUAL(rig_count(WIRE_HELLO), 1);
    CHECK_EQUAL(rig_count(WIRE_SAMPLE), 0);
}

TEST(arguments_out_of_range_change_nothing)
{
    static const struct {
        enum wire_type type;
        uint16_t argument;
    } wrong[] = {{WIRE_REQUEST_RANGE, 8},     {WIRE_REQUEST_RANGE, 65535}, {WIRE_REQUEST_RATE, 0},
                 {WIRE_REQUEST_RATE, 221},    {WIRE_REQUEST_TRIGGER, 2},   {WIRE_REQUEST_TRIGGER, 256}};
    rig_begin_streaming(1);
    for (int i = 0; i < 6; i++)
        CHECK_EQUAL(rig_ask(wrong[i].type, (uint8_t)i, 255, wrong[i].argument), RESULT_OUT_OF_RANGE);
    rig_ask(WIRE_REQUEST_HELLO, 9, 255, 0);
    const uint8_t *hello = rig_next(WIRE_HELLO);
    CHECK_EQUAL(hello[18], 220);
    CHECK_EQUAL(hello[20], 0x73);
}

TEST(pads_that_do_not_exist_are_refused)
{
    rig_begin_streaming(2);
    for (uint8_t type = WIRE_REQUEST_HELLO; type <= WIRE_REQUEST_STATUS; type++) {
        CHECK_EQUAL(rig_ask(type, 1, 2, 1), RESULT_NO_SUCH_PAD);
        CHECK_EQUAL(rig_ask(type, 1, 254, 1), RESULT_NO_SUCH_PAD);
    }
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, 1, 1, 1), RESULT_DONE);
}

TEST(setting_that_is_in_force_does_not_disturb_the_stream)
{
    rig_begin_streaming(1);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 1, 255, 3), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, 220), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, 0), RESULT_DONE);
    rig_run_ms(100);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        CHECK_EQUAL(rig_sample(packet).valid, 15);
}

TEST(request_with_bad_crc_gets_no_answer_and_is_counted)
{
    // request_rate of the golden vectors with its argument changed.
    static const uint8_t damaged[] = {0x05, 0x1a, 0x03, 0xff, 0x64, 0x03, 0x0d, 0x57, 0x00};
    rig_begin_streaming(1);
    device_receive(&rig.emulation.device, damaged, sizeof damaged);
    CHECK_EQUAL(rig_count(WIRE_REPLY), 0);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_STATUS, 1, 255, 0), RESULT_DONE);
    const uint8_t *status = rig_next(WIRE_STATUS);
    CHECK_EQUAL(status[11], 1);
    rig_ask(WIRE_REQUEST_HELLO, 2, 255, 0);
    CHECK_EQUAL(rig_next(WIRE_HELLO)[18], 220);
}

TEST(requests_are_found_between_garbage)
{
    uint32_t random = 7;
    rig_begin_streaming(1);
    for (int trial = 0; trial < 300; trial++) {
        uint8_t garbage[40];
        for (int i = 0; i < 40; i++) {
            random = random * 1664525U + 1013904223U;
            garbage[i] = (uint8_t)(random >> 24);
        }
        garbage[39] = 0;
        device_receive(&rig.emulation.device, garbage, sizeof garbage);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_HELLO, (uint8_t)trial, 255, 0), RESULT_DONE);
    }
    CHECK(rig.emulation.device.receive_errors >= 300);
}

TEST(reset_starts_numbers_and_time_anew_and_says_hello)
{
    rig_begin_streaming(1);
    rig_run_ms(1000);
    rig_forget();
    emulation_reset(&rig.emulation);
    rig_run_ms(300);
    CHECK_EQUAL(rig.packets[0].bytes[0], 0x10 | WIRE_HELLO);
    CHECK_EQUAL(rig_next(WIRE_HELLO)[4], RESET_SOFTWARE);
    struct sample_view view = rig_sample(rig_next(WIRE_SAMPLE));
    CHECK_EQUAL(view.sequence, 0);
    CHECK_BETWEEN(view.time_us, 1, 100000);
    CHECK_EQUAL(view.valid, 15);
}
