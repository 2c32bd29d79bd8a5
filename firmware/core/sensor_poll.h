// One look at a running sensor: is there a sample, is it new, and when to look again.
#ifndef FMFTS_SENSOR_POLL_H
#define FMFTS_SENSOR_POLL_H

#include "sensor.h"

enum bus_result sensor_poll(struct sensor *sensor, const struct sensor_link *link);

// Sets when the sensor wants the bus next.
void sensor_schedule(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us);

#endif
