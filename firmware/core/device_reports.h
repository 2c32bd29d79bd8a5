// What a board reports about itself and its sensors.
#ifndef FMFTS_DEVICE_REPORTS_H
#define FMFTS_DEVICE_REPORTS_H

#include <stddef.h>
#include <stdint.h>

#include "device.h"

// Counts the line as dropped if the board cannot send it.
void device_send(struct device *device, const uint8_t *line, size_t count);

void device_send_hello(struct device *device);
void device_send_status(struct device *device);

// The last result of this pad.
void device_send_selftest(struct device *device, uint8_t pad_index);

// Where the results of this pad's sensors are.
struct wire_selftest_sensor *device_results_of(struct device *device, uint8_t pad_index);

// The states of all sensors, four bits each.
uint64_t device_states(const struct device *device);

#endif
