// Operates one sensor: identifies, configures, polls and checks it, and identifies it again after a failure. One turn
// is a few short transfers.
#ifndef FMFTS_SENSOR_H
#define FMFTS_SENSOR_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "chips/chip.h"
#include "conversion.h"
#include "wire.h"

enum sensor_phase { PHASE_IDENTIFY, PHASE_RESET, PHASE_CONFIGURE, PHASE_RUN, PHASE_CHORE };

enum { SENSOR_ANY_ADDRESS = 0, SENSOR_CHORE_INTERVAL_US = 125000 };

enum sensor_film {
    FILM_UNDISTURBED,
    FILM_DOUBTFUL, // a field that a stronger one may imitate
    FILM_UPSET,
};

struct sensor {
    uint8_t address; // address for a chip that asks for it, or SENSOR_ANY_ADDRESS
    uint8_t state; // enum sensor_state
    uint8_t phase; // enum sensor_phase: what the next turn does
    uint8_t identification[3];
    uint8_t place;          // index into `chip_places`: the chip's kind and place
    uint8_t strikes;        // transfers without an answer, in a row
    uint8_t failures;       // calls of sensor_fail since the last good sample; set the back-off
    uint8_t missed;         // triggers without a conversion, in a row
    uint8_t ready_survives; // probes in a row that found READY set although the data had been read
    uint8_t unchanged;      // samples in a row with equal bytes while READY never cleared
    uint8_t doubts; // wrong identifications in a row
    bool has_sample;
    bool fresh;            // whether no frame has the last sample yet
    bool unsent;           // whether the last sample was not sent early
    bool discard_next;     // the next sample was converted with the old gain
    bool awaiting;         // a trigger's conversion has not been read yet
    bool confirmed;        // whether that conversion has ended: READY was set
    bool overtaken;        // triggered again before it was read: READY belongs to the new conversion
    bool suspect;          // a trigger's conversion was late or missing, and no later one ended in time
    bool unaltered;        // the last sample equals the one before
    bool temperature_next; // the next chore reads the temperature; the one after it checks the configuration
    uint8_t film; // the highest FILM_* since the last SET
    int16_t counts[3];
    int16_t temperature_raw;
    struct conversion conversion;
    uint64_t due_us; // when the sensor next needs the bus
    uint64_t triggered_us; // when the running conversion was triggered
    uint64_t settled_us; // conversions that end before this are not used
    uint32_t chore_us; // when the last chore was; for minutes the lower half of the clock suffices
    uint32_t set_us; // time of the last SET pulse
};

// Everything but the sensor that a turn needs. The mux channel to the sensor is already open.
struct sensor_link {
    const struct bus *bus;
    struct clock *clock;
    uint32_t *config_repairs;
    uint16_t rate_hz; // of frames
    uint8_t gain_code;
    uint8_t trigger; // enum trigger
};

// address: its own if no mux separates it from the others; otherwise SENSOR_ANY_ADDRESS.
void sensor_init(struct sensor *sensor, uint8_t address, uint64_t now_us, uint64_t first_chore_us);

// Does the sensor's next step.
enum bus_result sensor_turn(struct sensor *sensor, const struct sensor_link *link);

// The sensor did not answer. The third failure in a row calls sensor_fail.
void sensor_strike(struct sensor *sensor, uint64_t now_us);

// Pauses the sensor for a time that doubles with every failure; then it is identified and configured again.
void sensor_fail(struct sensor *sensor, enum sensor_state state, uint64_t now_us);

// Settings changed, or the self-test used the sensor: its samples are dropped, and it is configured again.
void sensor_reconfigure(struct sensor *sensor, uint64_t now_us);

// The sensor was triggered with all others at `triggered_us`: expect one conversion.
void sensor_await(struct sensor *sensor, uint64_t triggered_us);

// The sensor was triggered again: read the awaited sample now, before the new conversion ends and replaces it.
void sensor_overtake(struct sensor *sensor, uint64_t triggered_us);

// Asks whether the awaited conversion has ended; does not read the sample.
enum bus_result sensor_confirm(struct sensor *sensor, const struct sensor_link *link);

const struct chip *sensor_chip(const struct sensor *sensor);
struct chip_wires sensor_wires(const struct sensor *sensor, const struct sensor_link *link);
// It was set up, or got a SET pulse.
void sensor_was_set(struct sensor *sensor, uint64_t now_us);

bool sensor_is_identified(const struct sensor *sensor);
bool sensor_is_running(const struct sensor *sensor);

// Whether it measures by its own clock and without triggers.
bool sensor_streams(const struct sensor *sensor, enum trigger trigger);

// The time of the last sample: the middle of its measurement if its duration is known, else its end.
uint64_t sensor_time_us(const struct sensor *sensor, enum trigger trigger);

bool sensor_is_valid(const struct sensor *sensor, enum trigger trigger, uint64_t now_us);

#endif
