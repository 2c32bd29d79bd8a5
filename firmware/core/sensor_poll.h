// One poll of a running sensor: is there a new sample, and when is the next poll?
#ifndef FMFTS_SENSOR_POLL_H
#define FMFTS_SENSOR_POLL_H

#include "sensor.h"

enum bus_result sensor_poll(struct sensor *sensor, const struct sensor_link *link);

// Sets `due_us`, the time of the next poll or chore.
void sensor_schedule(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us);

#endif
