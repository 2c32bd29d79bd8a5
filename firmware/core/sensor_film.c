#include "sensor_film.h"

enum { SET_INTERVAL_US = 600000000 }; // each SET moves the zero by up to a sample's noise, so it is given seldom

static bool is_strong(const struct chip *chip, const int16_t counts[3])
{
    uint32_t norm = 0, strong = chip->strong_counts;
    for (int axis = 0; axis < 3; axis++) {
        if (counts[axis] == CHIP_SATURATED)
            return true;
        norm += (uint32_t)(counts[axis] * counts[axis]);
    }
    return norm > strong * strong;
}

bool sensor_film_needs_set(struct sensor *sensor, int16_t counts[3], uint32_t now_us)
{
    bool strong = is_strong(sensor_chip(sensor), counts);
    sensor->upset = sensor->upset || strong;
    for (int axis = 0; axis < 3 && sensor->upset; axis++)
        counts[axis] = CHIP_SATURATED;
    return !strong && (sensor->upset || now_us - sensor->set_us >= SET_INTERVAL_US);
}
