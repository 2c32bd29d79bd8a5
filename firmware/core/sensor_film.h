// The film of a chip with SET. A strong field may leave the film in any state, and its samples mean nothing until the
// next SET.
#ifndef FMFTS_SENSOR_FILM_H
#define FMFTS_SENSOR_FILM_H

#include "sensor.h"

// Marks all axes of this sample if a strong field was detected since the last SET. True: a SET is due, because that
// field is gone or the last SET was long ago.
bool sensor_film_needs_set(struct sensor *sensor, int16_t counts[3], uint32_t now_us);

#endif
