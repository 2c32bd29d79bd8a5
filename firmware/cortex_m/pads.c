#include "pads.h"

#include <stddef.h>

#include "../core/chips/chip.h"
#include "../core/tca9548a.h"
#include "../core/wire.h"

enum {
    ATTEMPTS = 3,
    CHANNELS_PER_PAD = SAMPLER_SENSORS_MAX,
    LOWER_CHANNELS = 0x0F,
    UPPER_CHANNELS = 0xF0,
};

static const struct pad_wiring assumed_pad = {0, TCA9548A_FIRST_ADDRESS, CHANNELS_PER_PAD, {0, 1, 2, 3}};

__attribute__((section(".noinit"))) static struct pads pads;

static uint16_t crc(void)
{
    return wire_crc((const uint8_t *)&pads, offsetof(struct pads, crc));
}

static void add(uint8_t bus, uint8_t mux_address, uint8_t first_channel)
{
    if (pads.count == SAMPLER_PADS_MAX)
        return;
    struct pad_wiring *wiring = &pads.wiring[pads.count++];
    *wiring = (struct pad_wiring){.bus = bus, .mux_address = mux_address, .sensor_count = CHANNELS_PER_PAD};
    for (uint8_t i = 0; i < CHANNELS_PER_PAD; i++)
        wiring->channels[i] = (uint8_t)(first_channel + i);
}

static bool select(const struct bus *bus, uint8_t mux_address, uint8_t channels)
{
    for (int attempt = 0; attempt < ATTEMPTS; attempt++)
        if (tca9548a_select(bus, mux_address, channels) == BUS_OK)
            return true;
    return false;
}

// Writes a zero, which any of the sensors acknowledges, and which is to them the number of a register or a command that
// does nothing. Reading is not possible while several channels are on; the RP2040 cannot send an address alone.
static bool sensor_answers(const struct bus *bus, uint8_t mux_address, uint8_t channels)
{
    const uint8_t nothing = 0;
    if (!select(bus, mux_address, channels))
        return false;
    for (int attempt = 0; attempt < ATTEMPTS; attempt++) {
        for (int place = 0; place < CHIP_PLACES; place++) {
            enum bus_result result = bus->write(bus->context, chip_places[place].address, &nothing, 1);
            if (result == BUS_OK)
                return true;
            if (result != BUS_NO_ANSWER)
                bus->recover(bus->context);
        }
    }
    return false;
}

static void find_on(const struct bus *bus, uint8_t bus_index)
{
    for (uint8_t address = TCA9548A_FIRST_ADDRESS; address < TCA9548A_FIRST_ADDRESS + TCA9548A_ADDRESSES; address++) {
        if (!select(bus, address, 0))
            continue;
        bool upper = sensor_answers(bus, address, UPPER_CHANNELS);
        if (!upper || sensor_answers(bus, address, LOWER_CHANNELS))
            add(bus_index, address, 0);
        if (upper)
            add(bus_index, address, CHANNELS_PER_PAD);
        select(bus, address, 0);
    }
}

const struct pads *pads_find(const struct bus *buses, const bool *usable, uint8_t bus_count, bool remembered)
{
    if (remembered && pads.count >= 1 && pads.count <= SAMPLER_PADS_MAX && pads.crc == crc())
        return &pads;
    pads.count = 0;
    for (uint8_t bus = 0; bus < bus_count; bus++)
        if (usable[bus])
            find_on(&buses[bus], bus);
    if (pads.count == 0)
        pads.wiring[pads.count++] = assumed_pad;
    pads.crc = crc();
    return &pads;
}
