#include "find_pads.h"

#include <stddef.h>

#include "../core/chips/chip.h"
#include "../core/tca9548a.h"

enum {
    ATTEMPTS = 3,
    LOWER_CHANNELS = 0x0F,
    UPPER_CHANNELS = 0xF0,
};

static const struct pad_wiring assumed_pad = {0, TCA9548A_FIRST_ADDRESS, PAD_SENSORS_FOUND, 0};

// Of the MLX90393: its pins A1 and A0 choose one of four from here on; two makers' boards have these (data sheet, ordering).
static const uint8_t direct_addresses[] = {0x0C, 0x18};

__attribute__((section(".noinit"))) static struct pads pads;

static void add(uint8_t bus, uint8_t mux_address, uint8_t first)
{
    if (pads.count < WIRE_PADS_MAX)
        pads.found[pads.count++] = (struct pad_wiring){bus, mux_address, PAD_SENSORS_FOUND, first};
}

static bool select(const struct bus *bus, uint8_t mux_address, uint8_t channels)
{
    for (int attempt = 0; attempt < ATTEMPTS; attempt++)
        if (tca9548a_select(bus, mux_address, channels) == BUS_OK)
            return true;
    return false;
}

// Writes a zero: every sensor acknowledges it, and takes it for the number of a register or for a command without
// effect. Reading is not possible while several channels are on; the RP2040 cannot send an address alone.
static bool acknowledges(const struct bus *bus, uint8_t address)
{
    const uint8_t nothing = 0;
    enum bus_result result = bus->write(bus->context, address, &nothing, 1);
    if (result != BUS_OK && result != BUS_NO_ANSWER)
        bus->recover(bus->context);
    return result == BUS_OK;
}

// A bit for each address of a chip: addresses above 31 use the lowest bits, where no chip has an address.
static uint32_t bit_of(uint8_t address)
{
    return 1U << (address < 32 ? address : address - 40);
}

// The addresses at which a sensor answers now, as bits. Those in `except` are not asked.
static uint32_t answering(const struct bus *bus, uint32_t except)
{
    uint32_t found = 0;
    for (int attempt = 0; attempt < ATTEMPTS; attempt++)
        for (int place = 0; place < CHIP_PLACES; place++) {
            uint32_t bit = bit_of(chip_places[place].address);
            if (!((found | except) & bit) && acknowledges(bus, chip_places[place].address))
                found |= bit;
        }
    return found;
}

static void find_behind(const struct bus *bus, uint8_t bus_index, uint8_t mux_address, uint32_t direct)
{
    bool upper = select(bus, mux_address, UPPER_CHANNELS) && answering(bus, direct);
    if (!upper || (select(bus, mux_address, LOWER_CHANNELS) && answering(bus, direct)))
        add(bus_index, mux_address, 0);
    if (upper)
        add(bus_index, mux_address, PAD_SENSORS_FOUND);
    select(bus, mux_address, 0);
}

static void find_on(const struct bus *bus, uint8_t bus_index)
{
    uint8_t muxes = 0;
    for (uint8_t i = 0; i < TCA9548A_ADDRESSES; i++)
        muxes |= (uint8_t)(select(bus, (uint8_t)(TCA9548A_FIRST_ADDRESS + i), 0) << i);
    // All channels are closed now: whatever answers sits on the bus itself, and will still answer later.
    const uint32_t direct = answering(bus, 0);
    for (uint8_t i = 0; i < TCA9548A_ADDRESSES; i++)
        if (muxes >> i & 1)
            find_behind(bus, bus_index, (uint8_t)(TCA9548A_FIRST_ADDRESS + i), direct);
    for (size_t i = 0; i < sizeof direct_addresses; i++) {
        uint32_t four = direct >> direct_addresses[i] & 0xF;
        if (four & (four - 1)) // more than one, because a single answer may come from a chip of another kind
            add(bus_index, TCA9548A_NONE, direct_addresses[i]);
    }
}

struct pads *find_pads(const struct bus *buses, const bool *usable, uint8_t bus_count, bool remembered)
{
    if (remembered && pads_are_whole(&pads))
        return &pads;
    pads = (struct pads){.count = 0};
    for (uint8_t bus = 0; bus < bus_count; bus++)
        if (usable[bus])
            find_on(&buses[bus], bus);
    if (pads.count == 0)
        pads.found[pads.count++] = assumed_pad;
    pads_seal(&pads);
    return &pads;
}
