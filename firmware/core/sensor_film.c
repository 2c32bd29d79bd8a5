#include "sensor_film.h"

enum { SET_INTERVAL_US = 600000000 }; // each SET moves the zero by up to a sample's noise, so it is rare

static bool is_beyond(const int16_t counts[3], uint16_t limit)
{
    uint32_t square = 0;
    for (int axis = 0; axis < 3; axis++) {
        if (counts[axis] == CHIP_SATURATED)
            return true;
        square += (uint32_t)(counts[axis] * counts[axis]);
    }
    return square > (uint32_t)limit * limit;
}

bool sensor_film_needs_set(struct sensor *sensor, int16_t counts[3], uint32_t now_us)
{
    const struct chip *chip = sensor_chip(sensor);
    uint8_t met = is_beyond(counts, chip->strong_counts)     ? FILM_UPSET
                  : is_beyond(counts, chip->doubtful_counts) ? FILM_DOUBTFUL
                                                             : FILM_UNDISTURBED;
    bool has_gone = met == FILM_UNDISTURBED && sensor->film != FILM_UNDISTURBED;
    sensor->film = met > sensor->film ? met : sensor->film;
    for (int axis = 0; axis < 3 && (sensor->film == FILM_UPSET || has_gone); axis++)
        counts[axis] = CHIP_SATURATED;
    return has_gone || (met == FILM_UNDISTURBED && now_us - sensor->set_us >= SET_INTERVAL_US);
}
