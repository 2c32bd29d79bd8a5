// The wire between board and host. firmware/wire.md is the definition; tests/data/wire_vectors.ini holds golden packets.
#ifndef FMFTS_WIRE_H
#define FMFTS_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    WIRE_VERSION = 1,
    WIRE_PADS_MAX = 3,
    WIRE_SENSORS_MAX = 8,
    WIRE_LINE_MAX = 256, // 254 bytes of packet, one COBS byte, the closing zero
    WIRE_REQUEST_SIZE = 7,
    WIRE_ALL_PADS = 255,
    WIRE_AGE_UNKNOWN = 65535,
    WIRE_TEMPERATURE_UNKNOWN = -32768,
    WIRE_UID_SIZE = 12,
};

enum wire_type {
    WIRE_SAMPLE = 1,
    WIRE_HELLO = 2,
    WIRE_STATUS = 3,
    WIRE_REPLY = 4,
    WIRE_SELFTEST = 5,
    WIRE_LOAD = 6,
    WIRE_EARLY = 7,
    WIRE_REQUEST_HELLO = 8,
    WIRE_REQUEST_RANGE = 9,
    WIRE_REQUEST_RATE = 10,
    WIRE_REQUEST_TRIGGER = 11,
    WIRE_REQUEST_START = 12,
    WIRE_REQUEST_STOP = 13,
    WIRE_REQUEST_SELFTEST = 14,
    WIRE_REQUEST_STATUS = 15,
};

enum wire_result { RESULT_DONE, RESULT_UNKNOWN_REQUEST, RESULT_OUT_OF_RANGE, RESULT_NO_SUCH_PAD, RESULT_BUSY };

enum trigger { TRIGGER_FREE, TRIGGER_SIMULTANEOUS };

enum sensor_state {
    SENSOR_OK,
    SENSOR_NO_ANSWER,
    SENSOR_WRONG_IDENTIFICATION,
    SENSOR_CONFIG_NOT_HELD,
    SENSOR_NO_NEW_DATA,
    SENSOR_SELFTEST_FAILED,
    SENSOR_BUS_STUCK,
    SENSOR_MUX_NO_ANSWER,
    SENSOR_NOT_STARTED,
};

struct wire_sample {
    uint8_t pad_index;
    uint8_t sensor_count;
    uint32_t sequence;
    uint64_t time_us;
    uint8_t gain_code;
    uint8_t trigger;
    uint8_t valid;
    uint8_t fresh;
    int16_t temperature_raw;
    int16_t counts[WIRE_SENSORS_MAX][3];
    uint16_t age_us[WIRE_SENSORS_MAX];
};

enum { WIRE_RUNNING = 1, WIRE_CAN_SEND_EARLY = 2, WIRE_CAN_MAKE_PADS = 4 };

struct wire_hello {
    uint8_t firmware_version[3];
    uint8_t reset_cause;
    uint8_t clock;
    uint8_t uid[WIRE_UID_SIZE];
    uint16_t rate_hz;
    uint8_t gain_code;
    uint8_t trigger;
    uint8_t flags; // WIRE_RUNNING, ...
    uint8_t pad_count;
    struct {
        uint8_t i2c_port;
        uint8_t mux_address;
        uint8_t sensor_count;
        struct {
            uint8_t channel;
            uint8_t state;
            uint8_t identification[3];
        } sensors[WIRE_SENSORS_MAX];
    } pads[WIRE_PADS_MAX];
};

struct wire_status {
    uint64_t time_us;
    uint32_t transmit_dropped;
    uint32_t receive_errors;
    uint8_t pad_count;
    struct {
        uint32_t bus_errors;
        uint32_t bus_recoveries;
        uint32_t config_repairs;
        uint8_t sensor_count;
        uint8_t state[WIRE_SENSORS_MAX];
    } pads[WIRE_PADS_MAX];
};

struct wire_reply {
    uint8_t request_id;
    uint8_t request_type;
    uint8_t result;
};

struct wire_selftest_sensor {
    uint8_t state;
    int16_t positive[3];
    int16_t negative[3];
};

struct wire_selftest {
    uint8_t request_id;
    uint8_t pad_index;
    uint8_t sensor_count;
    uint8_t gain_code;
    const struct wire_selftest_sensor *sensors;
};

struct wire_load {
    uint32_t sequence;
    uint64_t time_us;
    int32_t counts;
};

// The origin of an early sample. The highest bit keeps the byte from being zero, so that COBS leaves it as it is: a
// host finds the pad at once.
#define WIRE_PLACE(pad_index, sensor) ((uint8_t)(0x80 | (sensor) << 4 | (pad_index)))

struct wire_early {
    uint8_t place; // WIRE_PLACE
    uint8_t gain_code;
    uint64_t time_us;
    const int16_t *counts; // three
};

struct wire_request {
    uint8_t type;
    uint8_t request_id;
    uint8_t pad_index;
    uint16_t argument;
};

// Each encoder writes a whole line, closing zero included, and returns its length.
size_t wire_encode_sample(const struct wire_sample *sample, uint8_t line[WIRE_LINE_MAX]);
size_t wire_encode_hello(const struct wire_hello *hello, uint8_t line[WIRE_LINE_MAX]);
size_t wire_encode_status(const struct wire_status *status, uint8_t line[WIRE_LINE_MAX]);
size_t wire_encode_reply(const struct wire_reply *reply, uint8_t line[WIRE_LINE_MAX]);
size_t wire_encode_selftest(const struct wire_selftest *selftest, uint8_t line[WIRE_LINE_MAX]);
size_t wire_encode_load(const struct wire_load *load, uint8_t line[WIRE_LINE_MAX]);
size_t wire_encode_early(const struct wire_early *early, uint8_t line[WIRE_LINE_MAX]);

// CRC-16/CCITT-FALSE.
uint16_t wire_crc(const uint8_t *bytes, size_t count);

// Decodes one COBS block (without its closing zero) in place. Returns the decoded length, 0 when it is no COBS.
size_t wire_unstuff(uint8_t *bytes, size_t count);

// Collects bytes from the host. It has room for one request; boards accept nothing longer.
struct wire_decoder {
    uint8_t bytes[WIRE_REQUEST_SIZE + 1];
    uint8_t count;
    bool too_long;
    struct wire_request request;
};

enum wire_event { WIRE_NOTHING, WIRE_REQUEST, WIRE_BAD };

// WIRE_REQUEST: decoder->request holds a request. WIRE_BAD: a packet was dropped.
enum wire_event wire_decode(struct wire_decoder *decoder, uint8_t byte);

#endif
