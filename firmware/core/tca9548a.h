// The TCA9548A I2C switch (mux), and the route through the switches of one bus to a sensor.
#ifndef FMFTS_TCA9548A_H
#define FMFTS_TCA9548A_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"

enum {
    TCA9548A_FIRST_ADDRESS = 0x70,
    TCA9548A_ADDRESSES = 8,
    TCA9548A_NONE = 0, // instead of an address: the sensors sit on the bus itself HELLO uses 0 too
};

// A channel is connected only after the STOP that ends this transfer (data sheet 8.5.1): never join it with a read.
// Several channels may be on for a write; a read would return the wired-AND of all answers.
enum bus_result tca9548a_select(const struct bus *bus, uint8_t address, uint8_t channels);
enum bus_result tca9548a_selected(const struct bus *bus, uint8_t address, uint8_t *channels);

// All sensors answer at one address, so at most one switch of a bus may have channels on.
struct route {
    const struct bus *bus;
    uint8_t switches; // bit i: there is a switch at 0x70 + i
    bool known;
    uint8_t address;
    uint8_t channels;
};

void route_init(struct route *route, const struct bus *bus);
void route_add_switch(struct route *route, uint8_t address);

// Opens exactly these channels of this switch (TCA9548A_NONE: none) and closes all others. No transfer when they are
// open already.
// BUS_NO_ANSWER: this switch does not answer.
enum bus_result route_open(struct route *route, uint8_t address, uint8_t channels);

// Reads the control byte back. If the switch lost it (brown-out, RESET), the next route_open selects it again.
enum bus_result route_check(struct route *route, bool *held);

#endif
