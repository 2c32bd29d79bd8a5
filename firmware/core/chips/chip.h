// A kind of magnetometer as the sampler sees it; each kind has a file of its own in this folder, and hmc5983.c.
#ifndef FMFTS_CHIP_H
#define FMFTS_CHIP_H

#include <stdbool.h>
#include <stdint.h>

#include "../bus.h"
#include "../wire.h"

struct memsic;

// One chip. The mux channel to the chip is already open.
struct chip_wires {
    const struct bus *bus;
    uint8_t address;
    const struct memsic *memsic; // the registers of this kind (memsic.h); NULL for chips of other makers
};

struct chip_setup {
    uint8_t gain_code;
    uint8_t speed; // of the chip's `speeds`
    bool streams;  // whether it measures by its own clock; otherwise each measurement is triggered
};

// Rates of a stream, slowest first. Of a chip that is `paced`: how often the board reads one.
struct chip_speed {
    uint16_t rate_hz;
    uint16_t period_us;
};

// One measurement when the board triggers it.
struct chip_trigger {
    uint8_t bytes[2]; // what starts it
    uint8_t count;    // of these bytes
    uint16_t conversion_us;
    uint16_t wait_us;    // the same for the slowest chip, rounded up
    uint16_t fastest_us; // for the fastest chip, rounded down. 0: a sample must be read before the next trigger
    uint16_t rate_max_hz;
};

enum chip_status {
    CHIP_READY = 1,
    CHIP_LOCKED = 2, // the outputs are frozen until they are read
};

struct chip_sample {
    uint8_t status;
    int16_t counts[3];
    int16_t temperature_raw; // WIRE_TEMPERATURE_UNKNOWN unless the chip reports it with the axes
};

struct chip {
    uint8_t gain_codes;
    uint8_t speed_count;
    bool ready_unsure; // reading the outputs may leave READY set: the data sheet is ambiguous
    bool has_strap;    // the self-test of selftest.c
    bool paced;        // no stream of it is used: in free running it is triggered again after each read
    bool fills_period; // in a stream the measurements follow each other without a pause
    bool asked_by_writing; // `identify` sends commands that other chips may take for a register write
    uint16_t strong_counts; // a field of this norm may upset the film of a chip with `set`
    uint16_t doubtful_counts; // a stronger field may read as this value; a SET follows when the field has gone
    uint16_t reset_us; // what `reset` takes
    const struct chip_speed *speeds;
    const struct chip_trigger *trigger; // NULL: the chip measures only at its own times
    const struct memsic *memsic; // for `chip_wires`
    enum bus_result (*identify)(const struct chip_wires *wires, uint8_t identification[3]);
    bool (*is_identification)(const uint8_t identification[3]);
    enum bus_result (*reset)(const struct chip_wires *wires); // called before `set_up`; NULL: the chip needs no call
    enum bus_result (*set_up)(const struct chip_wires *wires, const struct chip_setup *setup);
    enum bus_result (*check)(const struct chip_wires *wires, const struct chip_setup *setup, bool *held);
    // A SET pulse, which `set_up` gives as well. A measurement must begin CHIP_SET_PAUSE_US later. NULL: it has none.
    enum bus_result (*set)(const struct chip_wires *wires);
    // The status, and whatever else the chip sends in the same transfer.
    enum bus_result (*read_status)(const struct chip_wires *wires, struct chip_sample *sample);
    // x, y, z in the counts of firmware/wire.md; saturated axes marked as the daemon's description of the chip says. NULL:
    // `read_status` brings them.
    enum bus_result (*read_counts)(const struct chip_wires *wires, int16_t counts[3]);
    enum bus_result (*read_thermometer)(const struct chip_wires *wires, int16_t *raw); // NULL: none, or that above
};

// A kind of chip and an address that it may have. The places are tried in order, which matters where kinds share an
// address: kinds that are recognised by writing come last.
struct chip_place {
    const struct chip *chip;
    uint8_t address;
};

enum {
    CHIP_PLACES = 23,
    CHIP_SATURATED = INT16_MIN,
    CHIP_SET_PAUSE_US = 1000, // the maker's sample code and ArduPilot wait 0.5 to 1 ms
};

extern const struct chip_place chip_places[CHIP_PLACES];
extern const struct chip chip_hmc5983, chip_qmc5883l, chip_qmc5883p, chip_mmc5983ma, chip_mmc5603nj, chip_mlx90393,
    chip_lis3mdl;

static inline enum bus_result chip_write(const struct chip_wires *wires, const uint8_t *bytes, size_t count)
{
    return wires->bus->write(wires->bus->context, wires->address, bytes, count);
}

static inline enum bus_result chip_read(const struct chip_wires *wires, uint8_t number, uint8_t *bytes, size_t count)
{
    return wires->bus->read_register(wires->bus->context, wires->address, number, bytes, count);
}

// The slowest speed that gives a new sample for every frame, else the fastest.
uint8_t chip_speed_for(const struct chip *chip, uint16_t rate_hz);

// The count, or CHIP_SATURATED where it is larger than the chip can tell.
int16_t chip_limited(int count, int largest);

#endif
