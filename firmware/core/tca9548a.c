#include "tca9548a.h"

// A switch that fails this often to answer a close counts as absent, so that the other switches can be used.
enum { CLOSE_ATTEMPTS = 3 };

enum bus_result tca9548a_select(const struct bus *bus, uint8_t address, uint8_t channels)
{
    return bus->write(bus->context, address, &channels, 1);
}

enum bus_result tca9548a_selected(const struct bus *bus, uint8_t address, uint8_t *channels)
{
    return bus->read(bus->context, address, channels, 1);
}

void route_init(struct route *route, const struct bus *bus)
{
    *route = (struct route){.bus = bus};
}

void route_add_switch(struct route *route, uint8_t address)
{
    route->switches |= (uint8_t)(1 << (address - TCA9548A_FIRST_ADDRESS));
}

static enum bus_result close_switch(const struct bus *bus, uint8_t address)
{
    enum bus_result result = BUS_NO_ANSWER;
    for (int attempt = 0; attempt < CLOSE_ATTEMPTS && result == BUS_NO_ANSWER; attempt++)
        result = tca9548a_select(bus, address, 0);
    return result == BUS_NO_ANSWER ? BUS_OK : result;
}

static enum bus_result close_others(struct route *route, uint8_t address)
{
    for (uint8_t i = 0; i < TCA9548A_ADDRESSES; i++) {
        uint8_t other = (uint8_t)(TCA9548A_FIRST_ADDRESS + i);
        bool may_be_open = (route->switches >> i & 1) && (!route->known || other == route->address);
        if (other == address || !may_be_open)
            continue;
        enum bus_result result = close_switch(route->bus, other);
        if (result != BUS_OK)
            return result;
    }
    return BUS_OK;
}

enum bus_result route_open(struct route *route, uint8_t address, uint8_t channels)
{
    if (route->known && route->address == address && route->channels == channels)
        return BUS_OK;
    enum bus_result result = close_others(route, address);
    route->known = false;
    if (result == BUS_OK && address != TCA9548A_NONE)
        result = tca9548a_select(route->bus, address, channels);
    if (result == BUS_OK) {
        route->known = true;
        route->address = address;
        route->channels = channels;
    }
    return result;
}

enum bus_result route_check(struct route *route, bool *held)
{
    uint8_t channels = 0;
    *held = true;
    if (route->address == TCA9548A_NONE)
        return BUS_OK;
    enum bus_result result = tca9548a_selected(route->bus, route->address, &channels);
    *held = result == BUS_OK && channels == route->channels;
    route->known = *held;
    return result;
}
