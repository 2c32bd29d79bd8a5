#include <string.h>

#include "../../firmware/core/wire.h"
#include "harness.h"
#include "vectors.h"

static size_t encode_sample(const struct vector *v, uint8_t *line)
{
    struct wire_sample sample = {
        .pad_index = (uint8_t)vector_get(v, "pad_index"),
        .sensor_count = (uint8_t)vector_get(v, "sensor_count"),
        .sequence = (uint32_t)vector_get(v, "sequence"),
        .time_us = (uint64_t)vector_get(v, "time_us"),
        .gain_code = (uint8_t)vector_get(v, "gain_code"),
        .trigger = (uint8_t)vector_get(v, "trigger"),
        .valid = (uint8_t)vector_get(v, "valid"),
        .fresh = (uint8_t)vector_get(v, "fresh"),
        .temperature_raw = (int16_t)vector_get(v, "temperature_raw"),
    };
    for (int i = 0; i < sample.sensor_count; i++) {
        for (int axis = 0; axis < 3; axis++)
            sample.counts[i][axis] = (int16_t)vector_at(v, "counts", 3 * i + axis);
        sample.age_us[i] = (uint16_t)vector_at(v, "age_us", i);
    }
    return wire_encode_sample(&sample, line);
}

static size_t encode_hello(const struct vector *v, uint8_t *line)
{
    struct wire_hello hello = {
        .reset_cause = (uint8_t)vector_get(v, "reset_cause"),
        .clock = (uint8_t)vector_get(v, "clock"),
        .rate_hz = (uint16_t)vector_get(v, "rate_hz"),
        .gain_code = (uint8_t)vector_get(v, "gain_code"),
        .trigger = (uint8_t)vector_get(v, "trigger"),
        .flags = (uint8_t)(vector_get(v, "running") | vector_get(v, "can_send_early") << 1 |
                           vector_get(v, "can_make_pads") << 2),
        .pad_count = (uint8_t)vector_get(v, "pad_count"),
    };
    for (int i = 0; i < 3; i++)
        hello.firmware_version[i] = (uint8_t)vector_at(v, "firmware_version", i);
    for (int i = 0; i < WIRE_UID_SIZE; i++)
        hello.uid[i] = (uint8_t)vector_at(v, "uid", i);
    for (int p = 0, s = 0; p < hello.pad_count; p++) {
        hello.pads[p].i2c_port = (uint8_t)vector_at(v, "i2c_port", p);
        hello.pads[p].mux_address = (uint8_t)vector_at(v, "mux_address", p);
        hello.pads[p].sensor_count = (uint8_t)vector_at(v, "sensor_count", p);
        for (int i = 0; i < hello.pads[p].sensor_count; i++, s++) {
            hello.pads[p].sensors[i].channel = (uint8_t)vector_at(v, "channel", s);
            hello.pads[p].sensors[i].state = (uint8_t)vector_at(v, "state", s);
            for (int byte = 0; byte < 3; byte++)
                hello.pads[p].sensors[i].identification[byte] = (uint8_t)vector_at(v, "identification", 3 * s + byte);
        }
    }
    return wire_encode_hello(&hello, line);
}

static size_t encode_status(const struct vector *v, uint8_t *line)
{
    struct wire_status status = {
        .time_us = (uint64_t)vector_get(v, "time_us"),
        .transmit_dropped = (uint32_t)vector_get(v, "transmit_dropped"),
        .receive_errors = (uint32_t)vector_get(v, "receive_errors"),
        .pad_count = (uint8_t)vector_get(v, "pad_count"),
    };
    for (int p = 0, s = 0; p < status.pad_count; p++) {
        status.pads[p].bus_errors = (uint32_t)vector_at(v, "bus_errors", p);
        status.pads[p].bus_recoveries = (uint32_t)vector_at(v, "bus_recoveries", p);
        status.pads[p].config_repairs = (uint32_t)vector_at(v, "config_repairs", p);
        status.pads[p].sensor_count = (uint8_t)vector_at(v, "sensor_count", p);
        for (int i = 0; i < status.pads[p].sensor_count; i++)
            status.pads[p].state[i] = (uint8_t)vector_at(v, "state", s++);
    }
    return wire_encode_status(&status, line);
}

static size_t encode_reply(const struct vector *v, uint8_t *line)
{
    const struct wire_reply reply = {
        .request_id = (uint8_t)vector_get(v, "request_id"),
        .request_type = (uint8_t)vector_get(v, "request_type"),
        .result = (uint8_t)vector_get(v, "result"),
    };
    return wire_encode_reply(&reply, line);
}

static size_t encode_selftest(const struct vector *v, uint8_t *line)
{
    struct wire_selftest_sensor sensors[WIRE_SENSORS_MAX];
    const struct wire_selftest selftest = {
        .request_id = (uint8_t)vector_get(v, "request_id"),
        .pad_index = (uint8_t)vector_get(v, "pad_index"),
        .sensor_count = (uint8_t)vector_get(v, "sensor_count"),
        .gain_code = (uint8_t)vector_get(v, "gain_code"),
        .sensors = sensors,
    };
    for (int i = 0; i < selftest.sensor_count; i++) {
        sensors[i].state = (uint8_t)vector_at(v, "state", i);
        for (int axis = 0; axis < 3; axis++) {
            sensors[i].positive[axis] = (int16_t)vector_at(v, "positive", 3 * i + axis);
            sensors[i].negative[axis] = (int16_t)vector_at(v, "negative", 3 * i + axis);
        }
    }
    return wire_encode_selftest(&selftest, line);
}

static size_t encode_load(const struct vector *v, uint8_t *line)
{
    const struct wire_load load = {
        .sequence = (uint32_t)vector_get(v, "sequence"),
        .time_us = (uint64_t)vector_get(v, "time_us"),
        .counts = (int32_t)vector_get(v, "counts"),
    };
    return wire_encode_load(&load, line);
}

static size_t encode_early(const struct vector *v, uint8_t *line)
{
    int16_t counts[3];
    struct wire_early early = {
        .counts = counts,
        .place = WIRE_PLACE(vector_get(v, "pad_index"), vector_get(v, "sensor")),
        .gain_code = (uint8_t)vector_get(v, "gain_code"),
        .time_us = (uint64_t)vector_get(v, "time_us"),
    };
    for (int axis = 0; axis < 3; axis++)
        counts[axis] = (int16_t)vector_at(v, "counts", axis);
    return wire_encode_early(&early, line);
}

TEST(encoders_make_the_golden_packets)
{
    static const struct {
        const char *type;
        size_t (*encode)(const struct vector *v, uint8_t *line);
    } encoders[] = {
        {"sample", encode_sample}, {"hello", encode_hello},       {"status", encode_status},
        {"reply", encode_reply},   {"selftest", encode_selftest}, {"load", encode_load},
        {"early", encode_early},
    };
    enum { ENCODERS = sizeof encoders / sizeof *encoders };
    static struct vector vector;
    int seen[ENCODERS] = {0};
    FILE *file = vectors_open();
    while (vectors_next(file, &vector)) {
        for (int i = 0; i < ENCODERS; i++) {
            uint8_t line[WIRE_LINE_MAX];
            if (strcmp(vector.type, encoders[i].type) != 0)
                continue;
            size_t count = encoders[i].encode(&vector, line);
            if (count != vector.line_count || memcmp(line, vector.line, count) != 0)
                harness_fail(__FILE__, __LINE__, "[%s] is not encoded to its golden line", vector.name);
            seen[i]++;
        }
    }
    fclose(file);
    for (int i = 0; i < ENCODERS; i++)
        CHECK(seen[i] > 0);
}

static enum wire_event feed(struct wire_decoder *decoder, const uint8_t *bytes, size_t count)
{
    enum wire_event last = WIRE_NOTHING;
    for (size_t i = 0; i < count; i++)
        last = wire_decode(decoder, bytes[i]);
    return last;
}

TEST(decoder_reads_the_golden_requests)
{
    static struct vector vector;
    struct wire_decoder decoder = {.count = 0};
    int seen = 0;
    FILE *file = vectors_open();
    while (vectors_next(file, &vector)) {
        if (strcmp(vector.type, "request") != 0)
            continue;
        CHECK_EQUAL(feed(&decoder, vector.line, vector.line_count), WIRE_REQUEST);
        CHECK_EQUAL(decoder.request.type, vector_get(&vector, "request_type"));
        CHECK_EQUAL(decoder.request.request_id, vector_get(&vector, "request_id"));
        CHECK_EQUAL(decoder.request.pad_index, vector_get(&vector, "pad_index"));
        CHECK_EQUAL(decoder.request.argument, vector_get(&vector, "argument"));
        seen++;
    }
    fclose(file);
    CHECK(seen >= 8);
}

TEST(decoder_refuses_every_board_packet)
{
    static struct vector vector;
    struct wire_decoder decoder = {.count = 0};
    FILE *file = vectors_open();
    while (vectors_next(file, &vector))
        if (strcmp(vector.type, "request") != 0)
            CHECK_EQUAL(feed(&decoder, vector.line, vector.line_count), WIRE_BAD);
    fclose(file);
}

// firmware/wire.md: request_rate of the golden vectors, 220 Hz, id 3.
static const uint8_t rate_request[] = {0x05, 0x1a, 0x03, 0xff, 0xdc, 0x03, 0x0d, 0x57, 0x00};

TEST(decoder_refuses_a_request_with_any_bit_flipped)
{
    for (size_t bit = 0; bit < 8 * (sizeof rate_request - 1); bit++) {
        struct wire_decoder decoder = {.count = 0};
        uint8_t flipped[sizeof rate_request];
        memcpy(flipped, rate_request, sizeof flipped);
        flipped[bit / 8] ^= (uint8_t)(1 << bit % 8);
        for (size_t i = 0; i < sizeof flipped; i++)
            CHECK(wire_decode(&decoder, flipped[i]) != WIRE_REQUEST);
    }
}

TEST(decoder_finds_the_request_after_any_garbage)
{
    uint32_t random = 1;
    for (int trial = 0; trial < 2000; trial++) {
        struct wire_decoder decoder = {.count = 0};
        for (int i = 0; i < trial % 40; i++) {
            random = random * 1664525U + 1013904223U;
            wire_decode(&decoder, (uint8_t)(random >> 24));
        }
        wire_decode(&decoder, 0);
        CHECK_EQUAL(feed(&decoder, rate_request, sizeof rate_request), WIRE_REQUEST);
        CHECK_EQUAL(decoder.request.argument, 220);
    }
}

TEST(decoder_counts_a_packet_that_is_too_long_once_and_goes_on)
{
    struct wire_decoder decoder = {.count = 0};
    for (int i = 0; i < 1000; i++)
        CHECK_EQUAL(wire_decode(&decoder, 7), WIRE_NOTHING);
    CHECK_EQUAL(wire_decode(&decoder, 0), WIRE_BAD);
    CHECK_EQUAL(feed(&decoder, rate_request, sizeof rate_request), WIRE_REQUEST);
}

TEST(decoder_ignores_empty_packets)
{
    struct wire_decoder decoder = {.count = 0};
    for (int i = 0; i < 10; i++)
        CHECK_EQUAL(wire_decode(&decoder, 0), WIRE_NOTHING);
}

// The same request with another header byte and a CRC that fits: only version or type is wrong.
static enum wire_event decode_with_header(uint8_t header)
{
    struct wire_decoder decoder = {.count = 0};
    uint8_t packet[7] = {header, 1, 255, 1, 1};
    uint16_t crc = wire_crc(packet, 5);
    packet[5] = (uint8_t)crc;
    packet[6] = (uint8_t)(crc >> 8);
    CHECK(packet[5] && packet[6]);
    wire_decode(&decoder, 8);
    feed(&decoder, packet, sizeof packet);
    return wire_decode(&decoder, 0);
}

TEST(decoder_refuses_other_versions_and_board_types)
{
    CHECK_EQUAL(decode_with_header(0x19), WIRE_REQUEST);
    CHECK_EQUAL(decode_with_header(0x29), WIRE_BAD);
    CHECK_EQUAL(decode_with_header(0x11), WIRE_BAD);
}

TEST(crc_has_the_check_value_of_its_catalogue)
{
    CHECK_EQUAL(wire_crc((const uint8_t *)"123456789", 9), 0x29B1);
}

TEST(unstuffing_refuses_what_no_sender_makes)
{
    uint8_t run_past_the_end[] = {5, 1, 2};
    uint8_t zero_inside[] = {2, 1, 0, 1};
    uint8_t nothing[] = {1};
    CHECK_EQUAL(wire_unstuff(run_past_the_end, 3), 0);
    CHECK_EQUAL(wire_unstuff(zero_inside, 4), 0);
    CHECK_EQUAL(wire_unstuff(nothing, 1), 0);
}

TEST(unstuffing_restores_254_bytes_without_a_zero)
{
    uint8_t block[255];
    memset(block, 0x5A, sizeof block);
    block[0] = 0xFF;
    CHECK_EQUAL(wire_unstuff(block, sizeof block), 254);
    CHECK_EQUAL(block[253], 0x5A);
}
