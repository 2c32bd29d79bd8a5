// The whole board, on emulated chips, under a host that asks for anything at any time.
// The first byte is the number of pads, and whether the first mux has eight chips. Then come pieces of six bytes: a
// request of five bytes and its damage, or, if the first is no header, how long the board works in between.
#include <string.h>

#include "../../../firmware/core/hmc5983.h"
#include "../../../firmware/host/emulation.h"
#include "fuzz.h"

enum { POLLS_MAX = 32, POLL_PAUSE_NS = 50000, PIECE = REQUEST_BODY + 1 };

static struct emulation emulation;
static int replies;
static uint8_t reply_id, reply_type, reply_result;

static bool keep(void *context, const uint8_t *line, size_t count)
{
    (void)context;
    uint8_t packet[WIRE_LINE_MAX];
    require(count > 4 && count <= WIRE_LINE_MAX, "a line is no longer than the wire allows");
    require(line[count - 1] == 0 && memchr(line, 0, count - 1) == NULL, "a line has one zero, at its end");
    size_t decoded = reference_unstuff(line, count - 1, packet);
    require(decoded > 2 && reference_crc(packet, decoded - 2) == (packet[decoded - 2] | packet[decoded - 1] << 8),
            "what the board sends has the right CRC");
    require(packet[0] >> 4 == WIRE_VERSION && (packet[0] & 15) >= WIRE_SAMPLE && (packet[0] & 15) <= WIRE_EARLY,
            "what the board sends is of a known type");
    if ((packet[0] & 15) == WIRE_EARLY) {
        const struct sampler *sampler = &emulation.device.sampler;
        unsigned pad_index = packet[1] & 15;
        require(decoded == 17 && packet[1] >> 7 && pad_index < sampler->pad_count && (sampler->early >> pad_index & 1),
                "only pads that were asked to send samples before their frames");
        require((packet[1] >> 4 & 7) < sampler->pads[pad_index].wiring.sensor_count, "of sensors that they have");
    }
    if ((packet[0] & 15) == WIRE_REPLY) {
        replies++;
        reply_id = packet[1];
        reply_type = packet[2];
        reply_result = packet[3];
    }
    return true;
}

static void check_settings(void)
{
    const struct sampler *sampler = &emulation.device.sampler;
    const struct sampler_settings *settings = &sampler->settings;
    require(settings->gain_code < HMC5983_GAIN_CODES, "the gain is one that the chip has");
    require(settings->trigger <= TRIGGER_SIMULTANEOUS, "the trigger is one of the two");
    // The limit of simultaneous triggers depends on the chips, which may be found after the request.
    require(settings->rate_hz >= 1 && settings->rate_hz <= RATE_MAX_HZ, "the rate is one of firmware/wire.md");
    require(emulation.bench.contentions == 0, "no two chips are read at once");
}

// Four bits for each pad: how many sensors it should have, 0 for four. More than four sensors take a whole mux.
static bool pads_can_be(unsigned wanted)
{
    const struct pads *pads = &emulation.pads;
    unsigned sensors = 0, left = pads->count;
    for (unsigned mux = 0; left > 0; mux++) {
        unsigned halves = mux == 0 && emulation.chip_count[0] == 8 ? 2 : 1;
        for (unsigned half = 0; half < halves; half++, left--) {
            unsigned count = wanted % 16 ? wanted % 16 : 4;
            wanted /= 16;
            sensors += count;
            if (count > 8 || (count > 4 && half > 0))
                return false;
            if (count > 4) {
                left -= halves;
                break;
            }
        }
    }
    return wanted == 0 && sensors <= 12;
}

// What firmware/wire.md says about a valid request, as long as no self-test keeps the board busy.
static enum wire_result expected_result(uint8_t type, uint8_t pad_index, unsigned argument)
{
    const struct sampler *sampler = &emulation.device.sampler;
    if (pad_index != WIRE_ALL_PADS && pad_index >= sampler->pad_count)
        return RESULT_NO_SUCH_PAD;
    bool in_range = type == WIRE_REQUEST_RANGE ? argument <= 7
                    : type == WIRE_REQUEST_RATE
                        ? argument >= 1 && argument <= sampler_rate_max(sampler, sampler->settings.trigger)
                    : type == WIRE_REQUEST_TRIGGER                 ? argument <= 1
                    : type == WIRE_REQUEST_HELLO && argument > 0 ? pads_can_be(argument)
                                                   : true;
    return in_range ? RESULT_DONE : RESULT_OUT_OF_RANGE;
}

static void ask(const uint8_t *piece)
{
    uint8_t line[REQUEST_LINE];
    uint32_t errors = emulation.device.receive_errors;
    bool whole = piece[REQUEST_BODY] == DAMAGE_NONE;
    uint8_t type = piece[0] & 15;
    enum wire_result expected = expected_result(type, piece[2], piece[3] + 256U * piece[4]);
    replies = 0;
    frame_request(piece, piece[REQUEST_BODY], line);
    device_receive(&emulation.device, line, sizeof line);
    if (whole) {
        bool anew = type == WIRE_REQUEST_HELLO && !emulation.device.announced; // its counters, too
        require(replies == 1, "a whole request gets one reply");
        require(emulation.device.receive_errors == errors || anew, "and is no error");
        require(reply_id == piece[1] && reply_type == type, "the reply names its request");
        bool busy = reply_result == RESULT_BUSY && expected == RESULT_DONE;
        require(reply_result == expected || busy, "the reply's result is the one that the wire's definition demands");
    } else {
        require(replies == 0, "a damaged request gets no reply");
        require(emulation.device.receive_errors == errors + 1, "a damaged request is counted");
    }
}

static void work(uint8_t polls)
{
    for (int i = 0; i < polls % POLLS_MAX; i++)
        if (!device_poll(&emulation.device))
            bench_pass_time(&emulation.bench, POLL_PAUSE_NS);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const uint8_t uid[WIRE_UID_SIZE] = {0};
    if (size == 0)
        return 0;
    emulation_init(&emulation, (uint8_t)(1 + data[0] % SAMPLER_PADS_MAX), uid, keep, NULL);
    if (data[0] / SAMPLER_PADS_MAX % 2 && emulation.switch_count < SAMPLER_PADS_MAX)
        emulation_fill_switch(&emulation);
    for (size_t at = 1; at + PIECE <= size; at += PIECE) {
        if (data[at] >> 4 == WIRE_VERSION && (data[at] & 15) >= WIRE_REQUEST_HELLO)
            ask(data + at);
        else
            work(data[at + 1]);
        check_settings();
    }
    return 0;
}
