#include "rig.h"

#include <string.h>

#include "harness.h"

struct rig rig;

// Reads the line as firmware/wire.md defines it; an incomplete line fails the test.
static bool keep(void *context, const uint8_t *line, size_t count)
{
    (void)context;
    uint8_t bytes[WIRE_LINE_MAX];
    if (rig.line_full)
        return false;
    CHECK(count <= sizeof bytes && line[count - 1] == 0 && memchr(line, 0, count - 1) == NULL);
    memcpy(bytes, line, count - 1);
    size_t decoded = wire_unstuff(bytes, count - 1);
    CHECK(decoded > 3);
    CHECK_EQUAL(wire_crc(bytes, decoded - 2), bytes[decoded - 2] | bytes[decoded - 1] << 8);
    CHECK(rig.count < RIG_PACKETS_MAX);
    struct packet *packet = &rig.packets[rig.count++];
    packet->at_ns = rig.emulation.bench.now_ns;
    packet->count = (uint8_t)(decoded - 2);
    memcpy(packet->bytes, bytes, decoded - 2);
    return true;
}

void rig_begin(uint8_t pads)
{
    static const uint8_t uid[WIRE_UID_SIZE] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    rig.count = rig.read = 0;
    rig.line_full = false;
    emulation_init(&rig.emulation, pads, uid, keep, NULL);
    for (int p = 0; p < pads; p++) {
        for (int i = 0; i < PAD_SENSORS_FOUND; i++) {
            struct emulated_chip *chip = &rig.emulation.chips[p][i];
            chip->noise_ut = 0;
            for (int axis = 0; axis < 3; axis++)
                chip->field_ut[axis] = 10.0 * (axis + 1) + i + 4 * p;
        }
    }
}

void rig_begin_streaming(uint8_t pads)
{
    rig_begin(pads);
    rig_run_ms(500);
    rig_forget();
}

void rig_run_ms(double ms)
{
    emulation_run_until(&rig.emulation, rig.emulation.bench.now_ns + (uint64_t)(ms * 1e6));
    CHECK_EQUAL(rig.emulation.bench.contentions, 0);
}

const uint8_t *rig_find(enum wire_type type)
{
    while (rig.read < rig.count) {
        const struct packet *packet = &rig.packets[rig.read++];
        if (packet->bytes[0] == (WIRE_VERSION << 4 | type))
            return packet->bytes;
    }
    return NULL;
}

const uint8_t *rig_next(enum wire_type type)
{
    const uint8_t *packet = rig_find(type);
    if (!packet)
        harness_fail(__FILE__, __LINE__, "no packet of type %d came", (int)type);
    return packet;
}

void rig_forget(void)
{
    rig.count = rig.read = 0;
}

int rig_count(enum wire_type type)
{
    int count = 0;
    for (int i = 0; i < rig.count; i++)
        count += rig.packets[i].bytes[0] == (WIRE_VERSION << 4 | type);
    return count;
}

void rig_request(enum wire_type type, uint8_t id, uint8_t pad_index, uint16_t argument)
{
    uint8_t packet[8] = {0, (uint8_t)(0x10 | type), id, pad_index, (uint8_t)argument, (uint8_t)(argument >> 8)};
    uint16_t crc = wire_crc(packet + 1, 5);
    packet[6] = (uint8_t)crc;
    packet[7] = (uint8_t)(crc >> 8);
    uint8_t *code = packet; // COBS
    for (uint8_t *at = packet + 1; at < packet + 8; at++) {
        if (*at == 0) {
            *code = (uint8_t)(at - code);
            code = at;
        }
    }
    *code = (uint8_t)(packet + 8 - code);
    const uint8_t zero = 0;
    device_receive(&rig.emulation.device, packet, sizeof packet);
    device_receive(&rig.emulation.device, &zero, 1);
}

int rig_ask(enum wire_type type, uint8_t id, uint8_t pad_index, uint16_t argument)
{
    rig.read = rig.count;
    rig_request(type, id, pad_index, argument);
    const uint8_t *reply = rig_find(WIRE_REPLY);
    if (!reply)
        return -1;
    CHECK_EQUAL(reply[1], id);
    CHECK_EQUAL(reply[2], type);
    return reply[3];
}

static uint64_t unsigned_at(const uint8_t *bytes, int size)
{
    uint64_t value = 0;
    for (int i = 0; i < size; i++)
        value |= (uint64_t)bytes[i] << (8 * i);
    return value;
}

struct sample_view rig_sample(const uint8_t *packet)
{
    struct sample_view view = {
        .pad_index = packet[1] & 15,
        .sensor_count = packet[1] >> 4,
        .sequence = (uint32_t)unsigned_at(packet + 2, 4),
        .time_us = unsigned_at(packet + 6, 6),
        .gain_code = packet[12] & 7,
        .trigger = packet[12] >> 3 & 1,
        .valid = packet[13],
        .fresh = packet[14],
        .temperature_raw = (int16_t)unsigned_at(packet + 15, 2),
    };
    for (int i = 0; i < view.sensor_count; i++) {
        for (int axis = 0; axis < 3; axis++)
            view.counts[i][axis] = (int16_t)unsigned_at(packet + 17 + 8 * i + 2 * axis, 2);
        view.age_us[i] = (uint16_t)unsigned_at(packet + 17 + 8 * i + 6, 2);
    }
    return view;
}

static const uint8_t *last_status(int pad)
{
    for (int i = rig.count - 1; i >= 0; i--) {
        const uint8_t *at = rig.packets[i].bytes + 16;
        if (rig.packets[i].bytes[0] != (WIRE_VERSION << 4 | WIRE_STATUS))
            continue;
        for (int p = 0; p < pad; p++)
            at += 13 + at[12];
        return at;
    }
    harness_fail(__FILE__, __LINE__, "no status came");
}

int rig_state(int pad, int sensor)
{
    return last_status(pad)[13 + sensor];
}

uint32_t rig_status_u32(int pad, int field)
{
    return (uint32_t)unsigned_at(last_status(pad) + 4 * field, 4);
}
