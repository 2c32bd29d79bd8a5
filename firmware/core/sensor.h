// One sensor's life: found, configured, polled, watched, given up and found again. One turn is a few short transfers.
#ifndef FMFTS_SENSOR_H
#define FMFTS_SENSOR_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "conversion.h"
#include "hmc5983.h"
#include "wire.h"

enum sensor_phase { PHASE_IDENTIFY, PHASE_CONFIGURE, PHASE_RUN, PHASE_CHORE };

struct sensor {
    uint8_t state; // enum sensor_state
    uint8_t phase; // enum sensor_phase: what the next turn does
    uint8_t identification[3];
    uint8_t strikes;        // transfers without an answer, in a row
    uint8_t failures;       // times given up since the last good sample; sets the back-off
    uint8_t missed;         // triggers without a conversion, in a row
    uint8_t ready_survives; // probes in a row that found READY set although the data had been read
    uint8_t unchanged;      // samples in a row with equal bytes while READY never cleared
    bool has_sample;
    bool fresh;            // not delivered yet
    bool discard_next;     // it was converted with the old gain
    bool awaiting;         // a trigger's conversion has not been read yet
    bool confirmed;        // that conversion was seen to have ended
    bool overtaken;        // triggered anew before that: READY is not about it any more
    bool suspect;          // a trigger's conversion was late or missing, and none was seen since
    bool unaltered;        // its last sample was the same as the one before
    bool temperature_next; // chores alternate
    int16_t counts[3];
    int16_t temperature_raw;
    struct conversion conversion;
    uint64_t due_us; // when it wants the bus next
    uint64_t overtaken_us;
    uint64_t settled_us;
    uint64_t chore_us;
};

// What a turn needs besides the sensor; the route to it is open.
struct sensor_link {
    const struct bus *bus;
    struct clock *clock;
    uint32_t *config_repairs;
    uint8_t gain_code;
    uint8_t trigger; // enum trigger
};

void sensor_init(struct sensor *sensor, uint64_t now_us, uint64_t first_chore_us);

// Does the sensor's next step.
enum bus_result sensor_turn(struct sensor *sensor, const struct sensor_link *link);

// It did not answer. Three times in a row and it is given up for a while.
void sensor_strike(struct sensor *sensor, uint64_t now_us);

// Gives it up for a back-off time that doubles with every failure; then it is identified and configured anew.
void sensor_fail(struct sensor *sensor, enum sensor_state state, uint64_t now_us);

// Settings changed or the self-test used it: what it holds is worth nothing now.
void sensor_reconfigure(struct sensor *sensor, uint64_t now_us);

// It was triggered along with others.
void sensor_await(struct sensor *sensor, uint64_t triggered_us);

// It was triggered again: what it awaits is to be read now, before the new conversion ends.
void sensor_overtake(struct sensor *sensor, uint64_t triggered_us);

// Asks whether the awaited conversion has ended, and reads nothing.
enum bus_result sensor_confirm(struct sensor *sensor, const struct sensor_link *link);

bool sensor_is_running(const struct sensor *sensor);
bool sensor_is_valid(const struct sensor *sensor, enum trigger trigger, uint64_t now_us);

#endif
