#include "wire.h"

#include <string.h>

// Four bits at a time, with a table of 32 bytes: four times as fast as one bit at a time.
uint16_t wire_crc(const uint8_t *bytes, size_t count)
{
    static const uint16_t remainders[16] = {
        0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
        0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
    };
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < count; i++) {
        crc = (uint16_t)(crc << 4 ^ remainders[crc >> 12 ^ bytes[i] >> 4]);
        crc = (uint16_t)(crc << 4 ^ remainders[crc >> 12 ^ (bytes[i] & 15)]);
    }
    return crc;
}

// Writes a packet from line + 1 on: COBS adds one leading byte, so finish() can apply it in place.
struct writer {
    uint8_t *line;
    uint8_t *end;
};

static void put(struct writer *writer, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        *writer->end++ = (uint8_t)(value >> (8 * i));
}

static void put_bytes(struct writer *writer, const uint8_t *bytes, size_t count)
{
    memcpy(writer->end, bytes, count);
    writer->end += count;
}

static void put_axes(struct writer *writer, const int16_t axes[3])
{
    for (int axis = 0; axis < 3; axis++)
        put(writer, (uint16_t)axes[axis], 2);
}

static struct writer begin(uint8_t *line, enum wire_type type)
{
    struct writer writer = {.line = line, .end = line + 1};
    put(&writer, (uint8_t)(WIRE_VERSION << 4 | type), 1);
    return writer;
}

// Appends the CRC, then replaces every zero by the distance to the next one: COBS of at most 254 bytes.
static size_t finish(struct writer *writer)
{
    put(writer, wire_crc(writer->line + 1, (size_t)(writer->end - writer->line - 1)), 2);
    uint8_t *zero = writer->line;
    for (uint8_t *at = writer->line + 1; at < writer->end; at++) {
        if (*at == 0) {
            *zero = (uint8_t)(at - zero);
            zero = at;
        }
    }
    *zero = (uint8_t)(writer->end - zero);
    *writer->end++ = 0;
    return (size_t)(writer->end - writer->line);
}

size_t wire_encode_sample(const struct wire_sample *sample, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_SAMPLE);
    put(&writer, (uint8_t)(sample->sensor_count << 4 | sample->pad_index), 1);
    put(&writer, sample->sequence, 4);
    put(&writer, sample->time_us, 6);
    put(&writer, (uint8_t)(sample->trigger << 3 | sample->gain_code), 1);
    put(&writer, sample->valid, 1);
    put(&writer, sample->fresh, 1);
    put(&writer, (uint16_t)sample->temperature_raw, 2);
    for (int i = 0; i < sample->sensor_count; i++) {
        put_axes(&writer, sample->counts[i]);
        put(&writer, sample->age_us[i], 2);
    }
    return finish(&writer);
}

size_t wire_encode_hello(const struct wire_hello *hello, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_HELLO);
    put_bytes(&writer, hello->firmware_version, sizeof hello->firmware_version);
    put(&writer, hello->reset_cause, 1);
    put(&writer, hello->clock, 1);
    put_bytes(&writer, hello->uid, sizeof hello->uid);
    put(&writer, hello->rate_hz, 2);
    put(&writer, (uint8_t)(hello->flags << 4 | hello->trigger << 3 | hello->gain_code), 1);
    put(&writer, hello->pad_count, 1);
    for (int pad = 0; pad < hello->pad_count; pad++) {
        put(&writer, hello->pads[pad].i2c_port, 1);
        put(&writer, hello->pads[pad].mux_address, 1);
        put(&writer, hello->pads[pad].sensor_count, 1);
        for (int i = 0; i < hello->pads[pad].sensor_count; i++) {
            put(&writer, hello->pads[pad].sensors[i].channel, 1);
            put(&writer, hello->pads[pad].sensors[i].state, 1);
            put_bytes(&writer, hello->pads[pad].sensors[i].identification, 3);
        }
    }
    return finish(&writer);
}

size_t wire_encode_status(const struct wire_status *status, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_STATUS);
    put(&writer, status->time_us, 6);
    put(&writer, status->transmit_dropped, 4);
    put(&writer, status->receive_errors, 4);
    put(&writer, status->pad_count, 1);
    for (int pad = 0; pad < status->pad_count; pad++) {
        put(&writer, status->pads[pad].bus_errors, 4);
        put(&writer, status->pads[pad].bus_recoveries, 4);
        put(&writer, status->pads[pad].config_repairs, 4);
        put(&writer, status->pads[pad].sensor_count, 1);
        put_bytes(&writer, status->pads[pad].state, status->pads[pad].sensor_count);
    }
    return finish(&writer);
}

size_t wire_encode_reply(const struct wire_reply *reply, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_REPLY);
    put(&writer, reply->request_id, 1);
    put(&writer, reply->request_type, 1);
    put(&writer, reply->result, 1);
    return finish(&writer);
}

size_t wire_encode_selftest(const struct wire_selftest *selftest, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_SELFTEST);
    put(&writer, selftest->request_id, 1);
    put(&writer, (uint8_t)(selftest->sensor_count << 4 | selftest->pad_index), 1);
    put(&writer, selftest->gain_code, 1);
    for (int i = 0; i < selftest->sensor_count; i++) {
        put(&writer, selftest->sensors[i].state, 1);
        put_axes(&writer, selftest->sensors[i].positive);
        put_axes(&writer, selftest->sensors[i].negative);
    }
    return finish(&writer);
}

size_t wire_encode_load(const struct wire_load *load, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_LOAD);
    put(&writer, load->sequence, 4);
    put(&writer, load->time_us, 6);
    put(&writer, (uint32_t)load->counts, 4);
    return finish(&writer);
}

size_t wire_encode_early(const struct wire_early *early, uint8_t line[WIRE_LINE_MAX])
{
    struct writer writer = begin(line, WIRE_EARLY);
    put(&writer, (uint16_t)(early->gain_code << 8 | early->place), 2);
    put(&writer, early->time_us, 6);
    put_axes(&writer, early->counts);
    return finish(&writer);
}

size_t wire_unstuff(uint8_t *bytes, size_t count)
{
    size_t at = 0, out = 0;
    while (at < count) {
        uint8_t code = bytes[at++];
        size_t run = (size_t)code - 1;
        if (code == 0 || run > count - at)
            return 0;
        memmove(bytes + out, bytes + at, run);
        out += run;
        at += run;
        if (code != 0xFF && at < count)
            bytes[out++] = 0;
    }
    return out;
}

static bool parse_request(const uint8_t *packet, size_t count, struct wire_request *request)
{
    if (count != WIRE_REQUEST_SIZE || packet[0] >> 4 != WIRE_VERSION || (packet[0] & 0x0F) < WIRE_REQUEST_HELLO)
        return false;
    if (wire_crc(packet, count - 2) != (packet[count - 2] | packet[count - 1] << 8))
        return false;
    *request = (struct wire_request){
        .type = packet[0] & 0x0F,
        .request_id = packet[1],
        .pad_index = packet[2],
        .argument = (uint16_t)(packet[3] | packet[4] << 8),
    };
    return true;
}

enum wire_event wire_decode(struct wire_decoder *decoder, uint8_t byte)
{
    if (byte != 0) {
        if (decoder->count < sizeof decoder->bytes)
            decoder->bytes[decoder->count++] = byte;
        else
            decoder->too_long = true;
        return WIRE_NOTHING;
    }
    size_t count = decoder->count;
    bool too_long = decoder->too_long;
    decoder->count = 0;
    decoder->too_long = false;
    if (count == 0)
        return WIRE_NOTHING;
    size_t decoded = too_long ? 0 : wire_unstuff(decoder->bytes, count);
    return parse_request(decoder->bytes, decoded, &decoder->request) ? WIRE_REQUEST : WIRE_BAD;
}
