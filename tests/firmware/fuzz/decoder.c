// The board's frame decoder: whatever bytes come, it accepts exactly the packets that firmware/wire.md allows.
// An input whose first byte is odd is a series of framed requests, each damaged or not; any other is used as bytes.
#include <string.h>

#include "../../../firmware/core/wire.h"
#include "fuzz.h"

enum { BLOCK_MAX = 4096 };

static struct wire_decoder decoder;
static uint8_t block[BLOCK_MAX]; // since the last zero
static size_t collected;

static bool is_request(struct wire_request *request)
{
    uint8_t packet[BLOCK_MAX];
    size_t count = reference_unstuff(block, collected, packet);
    if (count != WIRE_REQUEST_SIZE || packet[0] >> 4 != WIRE_VERSION || (packet[0] & 15) < WIRE_REQUEST_HELLO)
        return false;
    uint16_t crc = reference_crc(packet, count - 2);
    *request = (struct wire_request){
        .type = packet[0] & 15,
        .request_id = packet[1],
        .pad_index = packet[2],
        .argument = (uint16_t)(packet[3] + 256 * packet[4]),
    };
    return packet[5] == (crc & 0xFF) && packet[6] == crc >> 8;
}

static void decode(uint8_t byte)
{
    enum wire_event event = wire_decode(&decoder, byte);
    if (byte != 0) {
        require(event == WIRE_NOTHING, "nothing is decided before a packet's end");
        block[collected++] = byte;
        return;
    }
    struct wire_request expected = {0};
    bool good = is_request(&expected);
    require(good == (event == WIRE_REQUEST), "a packet is accepted if, and only if, it is whole and its CRC is right");
    require((collected == 0) == (event == WIRE_NOTHING), "an empty packet is ignored, and nothing else is");
    if (good) {
        const struct wire_request *request = &decoder.request;
        require(request->type == expected.type && request->request_id == expected.request_id &&
                    request->pad_index == expected.pad_index && request->argument == expected.argument,
                "the request is the one that was sent");
    }
    collected = 0;
}

static void unstuff(const uint8_t *data, size_t size)
{
    uint8_t bytes[WIRE_LINE_MAX], packet[WIRE_LINE_MAX];
    size_t count = size < sizeof bytes ? size : sizeof bytes;
    if (count > 0)
        memcpy(bytes, data, count);
    size_t expected = reference_unstuff(bytes, count, packet);
    require(wire_unstuff(bytes, count) == expected, "COBS decodes to the same length");
    require(expected == 0 || memcmp(bytes, packet, expected) == 0, "COBS decodes to the same bytes");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    memset(&decoder, 0, sizeof decoder);
    collected = 0;
    unstuff(data, size);
    if (size > BLOCK_MAX)
        return 0;
    if (size == 0 || data[0] % 2 == 0) {
        for (size_t i = 0; i < size; i++)
            decode(data[i]);
    } else {
        for (size_t at = 1; at + REQUEST_BODY < size; at += REQUEST_BODY + 1) {
            uint8_t line[REQUEST_LINE];
            frame_request(data + at, data[at + REQUEST_BODY], line);
            for (size_t i = 0; i < sizeof line; i++)
                decode(line[i]);
        }
    }
    decode(0);
    return 0;
}
