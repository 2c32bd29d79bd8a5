// Everything that is judged about a pad, over frames with any faults: published numbers are finite, describe only
// existing sensors, and fit into a message; a frame that cannot be published leaves the memory unchanged. After a first
// byte for the kind of pad, pieces of eight: flags, a sensor, axis and shift, two numbers, masks, and a depth.
#include "../firmware/fuzz/fuzz.h"
#include "made_pad.h"

enum { PIECE = 8, AGAIN = 16 };
enum { LEAP = 1, STALE = 2, FAULT = 4, BEFORE = 8, LOST = 16, OFTEN = 32, PRESS = 64, TEMPERATURE = 128 };

typedef struct {
    int64_t time_us, host_ns, sequence;
    int fault[FMFTS_AXES];
    double moved_m[3], temperature_c;
    uint8_t readings[FMFTS_READING_BYTES * FMFTS_SENSORS];
} board;

static int16_t number_of(const uint8_t *bytes)
{
    return (int16_t)(bytes[0] | bytes[1] << 8);
}

static void put(uint8_t *bytes, int value)
{
    bytes[0] = (uint8_t)value;
    bytes[1] = (uint8_t)(value >> 8);
}

// Of -2 to 2 counts.
static int noise_of(const board *b, int axis)
{
    uint32_t mixed = ((uint32_t)b->sequence * 48 + (uint32_t)axis) * 2654435761u;
    return (int)((mixed ^ mixed >> 15) * 2246822519u >> 16) % 5 - 2;
}

static int count_of(const board *b, const double field_t[3], int axis)
{
    double count = field_t[axis % 3] / STEP_T + b->fault[axis] + noise_of(b, axis);
    return count > 32767.0 ? 32767 : count < -32768.0 ? -32768 : (int)count;
}

static void read_sensors(const fmfts_pose_parameters *p, board *b)
{
    for (int i = 0; i < (int)p->sensors; i++) {
        double field_t[3];
        field_at(p, i, b->moved_m, field_t);
        for (int k = 0; k < 3; k++)
            put(b->readings + FMFTS_READING_BYTES * i + 2 * k, count_of(b, field_t, 3 * i + k));
        put(b->readings + FMFTS_READING_BYTES * i + 6, (int)((unsigned)(i * 1100 + b->sequence) % 4545));
    }
}

static void check(const made_pad *made, const fmfts_reading *reading)
{
    const fmfts_pose_memory *memory = &made->memory.pose;
    int sensors = (int)made->parameters.pose.sensors;
    uint8_t message[FMFTS_MESSAGE_ROOM];
    const fmfts_times times = {1, 2, 3, 4};
    require(fmfts_is_finite(reading), "what is told is finite");
    require(fmfts_write_message(&made->pad.words, reading, 1, &times, message) > 0, "it fits into a message");
    require(reading->health < FMFTS_HEALTHS, "there is such a health");
    require(reading->health == FMFTS_OK || reading->reason.size > 0, "what is not ok says why");
    require(reading->sensors_ok >> sensors == 0, "sensors that are used are there");
    require(memory->found_sensor >= -1 && memory->found_sensor < sensors, "a sensor that is blamed is there");
    require((memory->heard | memory->suspects | memory->searched_sensors) >> sensors == 0, "so are those that are suspected");
    require(!reading->tells_force || reading->contact != FMFTS_NOT_KNOWN, "a force is told where a contact is known");
}

static void judge(made_pad *made, board *b, unsigned masks, unsigned gain_code, fmfts_reading *reading)
{
    static fmfts_memory before;
    const fmfts_frame frame = {b->readings,       b->time_us, b->host_ns,  b->sequence,
                               b->temperature_c, gain_code,  masks >> 8, masks & 255};
    before = made->memory;
    read_sensors(&made->parameters.pose, b);
    if (fmfts_judge(&made->pad, &made->memory, &frame, reading))
        check(made, reading);
    else
        require(memcmp(&before, &made->memory, sizeof before) == 0, "a frame that cannot be told changes nothing");
}

static void follow(made_pad *made, const board *b, int sensor, fmfts_reading *reading)
{
    const int16_t counts[3] = {(int16_t)b->fault[0], 0, -500};
    fmfts_early early = {.sensor = sensor, .time_us = b->time_us + 1500};
    fmfts_read_early(&made->parameters.pose, 0, counts, early.field_t);
    if (fmfts_take_early(&made->pad, &made->memory, &early, reading))
        check(made, reading);
}

// A board counts 48 bits, and a host from its start.
static int64_t within(int64_t value, int64_t most)
{
    return value < 0 ? 0 : value > most ? most : value;
}

static void go_on(board *b, const uint8_t *piece)
{
    int64_t leap_us = piece[0] & LEAP ? (int64_t)number_of(piece + 2) * (INT64_C(1) << piece[1] % 32) : 0;
    int64_t frames = piece[0] & LOST ? 1 + piece[7] : 1;
    b->time_us = within(b->time_us + leap_us + frames * 4545, (INT64_C(1) << 48) - 1);
    int64_t late_ns = piece[1] & 128 ? (int64_t)number_of(piece + 4) * 1000000 : 0;
    b->host_ns = within(b->host_ns + frames * 4545000 + late_ns, INT64_C(1) << 60);
    b->sequence += frames;
}

static void take(made_pad *made, board *b, const uint8_t *piece)
{
    fmfts_reading reading;
    int axes = 3 * (int)made->parameters.pose.sensors, axis = piece[1] % axes;
    unsigned all = (1u << axes / 3) - 1, some = piece[6] & all;
    unsigned fresh = piece[0] & STALE ? some : all, valid = piece[6] & 128 ? some : all;
    memset(&reading, 0, sizeof reading);
    if (piece[0] & FAULT)
        b->fault[axis] = number_of(piece + 4);
    if (piece[0] & PRESS) {
        b->moved_m[0] = 1e-8 * number_of(piece + 2);
        b->moved_m[1] = 1e-8 * number_of(piece + 4);
        b->moved_m[2] = -1e-5 * piece[7] + (piece[1] & 64 ? 1e-3 : 0.0);
    }
    if (piece[0] & TEMPERATURE)
        b->temperature_c = piece[7] == 255 ? NAN : piece[7] - 50.0;
    for (int repeats = piece[0] & OFTEN ? AGAIN : 1; repeats > 0; repeats--) {
        go_on(b, piece);
        judge(made, b, valid << 8 | fresh, piece[1] & 7, &reading);
        if (piece[0] & BEFORE)
            follow(made, b, piece[6] % (axes / 3 + 1), &reading);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static made_pad made;
    static int made_of = -1;
    if (size == 0)
        return 0;
    if (made_of != data[0])
        make_pad(data[0], &made);
    made_of = data[0];
    make_memory(&made.parameters.pose, &made.memory);
    made.other[43] = NAN;
    board b = {.time_us = 1000000, .host_ns = INT64_C(2000000000), .temperature_c = 25.0};
    for (size_t at = 1; at + PIECE <= size; at += PIECE)
        take(&made, &b, data + at);
    return 0;
}
