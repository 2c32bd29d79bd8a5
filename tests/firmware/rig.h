// A whole emulated board whose packets are taken apart and kept, for tests of what a host would see.
#ifndef FMFTS_TEST_RIG_H
#define FMFTS_TEST_RIG_H

#include "../../firmware/host/emulation.h"

enum { RIG_PACKETS_MAX = 20000, RIG_PACKET_MAX = 254 };

struct packet {
    uint64_t at_ns; // virtual time of sending
    uint8_t count;
    uint8_t bytes[RIG_PACKET_MAX]; // from the header on, without the CRC
};

struct rig {
    struct emulation emulation;
    bool line_full;
    int count;
    int read; // the next one that `rig_next` looks at
    struct packet packets[RIG_PACKETS_MAX];
};

extern struct rig rig;

// Starts a board with this many pads. All chips see the field (10 + i, 20 + i, 30 + i) µT without noise, where i is
// their number.
void rig_begin(uint8_t pads);
// The same half a second later, its packets forgotten.
void rig_begin_streaming(uint8_t pads);
void rig_run_ms(double ms);

// The next packet of this type since the last call; the test fails if there is none.
const uint8_t *rig_next(enum wire_type type);
// Like the function above, but NULL if there is none.
const uint8_t *rig_find(enum wire_type type);
void rig_forget(void);
int rig_count(enum wire_type type);

void rig_request(enum wire_type type, uint8_t id, uint8_t pad_index, uint16_t argument);
// Sends a request and returns the result of its reply, −1 when none comes.
int rig_ask(enum wire_type type, uint8_t id, uint8_t pad_index, uint16_t argument);

struct sample_view {
    uint8_t pad_index, sensor_count, gain_code, trigger, valid, fresh;
    uint32_t sequence;
    uint64_t time_us;
    int16_t temperature_raw;
    int16_t counts[8][3];
    uint16_t age_us[8];
};

struct sample_view rig_sample(const uint8_t *packet);

// The state of a sensor in the last status.
int rig_state(int pad, int sensor);
uint32_t rig_status_u32(int pad, int field); // 0 bus errors, 1 bus recoveries, 2 config repairs

#endif
