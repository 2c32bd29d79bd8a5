#include "device_reports.h"

#include <string.h>

#include "hmc5983.h"

enum { STATUS_INTERVAL_US = 1000000 };

void device_send(struct device *device, const uint8_t *line, size_t count)
{
    if (!device->board->send(device->board->context, line, count))
        device->transmit_dropped++;
}

void device_send_hello(struct device *device)
{
    const struct board *board = device->board;
    const struct sampler *sampler = &device->sampler;
    uint8_t line[WIRE_LINE_MAX];
    struct wire_hello hello = {
        .firmware_version = {FIRMWARE_MAJOR, FIRMWARE_MINOR, FIRMWARE_PATCH},
        .reset_cause = board->reset_cause,
        .clock = board->clock_source,
        .rate_hz = sampler->settings.rate_hz,
        .gain_code = sampler->settings.gain_code,
        .trigger = sampler->settings.trigger,
        .flags = WIRE_CAN_MAKE_PADS | WIRE_CAN_SEND_EARLY | device->running, // bit 0 is WIRE_RUNNING
        .pad_count = sampler->pad_count,
    };
    memcpy(hello.uid, board->uid, sizeof hello.uid);
    for (int p = 0; p < sampler->pad_count; p++) {
        const struct sampler_pad *pad = &sampler->pads[p];
        hello.pads[p].i2c_port = board->i2c_ports[pad->wiring.bus];
        hello.pads[p].mux_address = pad->wiring.mux_address;
        hello.pads[p].sensor_count = pad->wiring.sensor_count;
        for (int i = 0; i < pad->wiring.sensor_count; i++) {
            hello.pads[p].sensors[i].channel = (uint8_t)(pad->wiring.first + i);
            hello.pads[p].sensors[i].state = pad->sensors[i].state;
            memcpy(hello.pads[p].sensors[i].identification, pad->sensors[i].identification, 3);
        }
    }
    device_send(device, line, wire_encode_hello(&hello, line));
}

uint64_t device_states(const struct device *device)
{
    uint64_t packed = 0;
    for (int i = 0; i < device->sampler.sensor_count; i++)
        packed = packed << 4 | device->sampler.sensors[i].state;
    return packed;
}

void device_send_status(struct device *device)
{
    const struct sampler *sampler = &device->sampler;
    uint8_t line[WIRE_LINE_MAX];
    struct wire_status status = {
        .time_us = clock_now(&device->clock),
        .transmit_dropped = device->transmit_dropped,
        .receive_errors = device->receive_errors,
        .pad_count = sampler->pad_count,
    };
    for (int p = 0; p < sampler->pad_count; p++) {
        const struct sampler_pad *pad = &sampler->pads[p];
        status.pads[p].bus_errors = pad->bus_errors;
        status.pads[p].bus_recoveries = sampler->buses[pad->wiring.bus].recoveries;
        status.pads[p].config_repairs = pad->config_repairs;
        status.pads[p].sensor_count = pad->wiring.sensor_count;
        for (int i = 0; i < pad->wiring.sensor_count; i++)
            status.pads[p].state[i] = pad->sensors[i].state;
    }
    device->reported_states = device_states(device);
    device->reported_us = status.time_us;
    device->status_us = status.time_us + STATUS_INTERVAL_US;
    device_send(device, line, wire_encode_status(&status, line));
}

struct wire_selftest_sensor *device_results_of(struct device *device, uint8_t pad_index)
{
    return device->results + (device->sampler.pads[pad_index].sensors - device->sampler.sensors);
}

void device_send_selftest(struct device *device, uint8_t pad_index)
{
    uint8_t line[WIRE_LINE_MAX];
    const struct wire_selftest selftest = {
        .request_id = device->selftest_id,
        .pad_index = pad_index,
        .sensor_count = device->sampler.pads[pad_index].wiring.sensor_count,
        .gain_code = HMC5983_SELFTEST_GAIN,
        .sensors = device_results_of(device, pad_index),
    };
    device_send(device, line, wire_encode_selftest(&selftest, line));
}
