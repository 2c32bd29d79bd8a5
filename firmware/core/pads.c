#include "pads.h"

#include <stddef.h>

#include "tca9548a.h"

static uint16_t crc(const struct pads *pads)
{
    return wire_crc((const uint8_t *)pads, offsetof(struct pads, crc));
}

void pads_seal(struct pads *pads)
{
    pads->crc = crc(pads);
}

bool pads_are_whole(const struct pads *pads)
{
    return pads->count >= 1 && pads->count <= WIRE_PADS_MAX && pads->crc == crc(pads);
}

static bool share_a_mux(const struct pad_wiring *one, const struct pad_wiring *other)
{
    return one->bus == other->bus && one->mux_address == other->mux_address && one->mux_address != TCA9548A_NONE;
}

uint8_t pads_make(const struct pads *pads, uint16_t wanted, struct pad_wiring wiring[WIRE_PADS_MAX])
{
    uint8_t count = 0;
    int sensors = 0;
    for (int f = 0; f < pads->count; f++) {
        struct pad_wiring pad = pads->found[f];
        bool mux_in_use = count && share_a_mux(&wiring[count - 1], &pad);
        if (mux_in_use && wiring[count - 1].sensor_count > PAD_SENSORS_FOUND)
            continue; // the sensor is part of that pad
        uint8_t asked = wanted & 15;
        wanted = (uint16_t)(wanted >> 4);
        if (asked > PAD_SENSORS_FOUND) {
            if (asked > PAD_SENSORS_MAX || mux_in_use || pad.mux_address == TCA9548A_NONE)
                return 0;
            pad.first = 0;
        }
        pad.sensor_count = asked ? asked : PAD_SENSORS_FOUND;
        sensors += pad.sensor_count;
        wiring[count++] = pad;
    }
    return wanted || sensors > PADS_SENSORS_MAX ? 0 : count;
}
