#include "device.h"

#include <string.h>

#include "hmc5983.h"

enum {
    STATUS_INTERVAL_US = 1000000,
    STATUS_PAUSE_US = 50000, // least time between two status packets, when sensor states change
    HELLO_WAIT_US = 250000,  // the hello waits so long for sensors that were not tried yet
    SELFTEST_REPEAT_US = 5000000,
};

void device_init(struct device *device, const struct board *board)
{
    memset(device, 0, sizeof *device);
    device->board = board;
    device->clock = (struct clock){.now_us = board->now_us, .context = board->context};
    device->running = true;
    sampler_init(&device->sampler, &device->clock, board->buses, board->bus_count, board->pads, board->pad_count);
}

static void send(struct device *device, const uint8_t *line, size_t count)
{
    if (!device->board->send(device->board->context, line, count))
        device->transmit_dropped++;
}

static void send_hello(struct device *device)
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
        .flags = WIRE_CAN_SEND_EARLY | device->running, // bit 0 is WIRE_RUNNING
        .pad_count = sampler->pad_count,
    };
    memcpy(hello.uid, board->uid, sizeof hello.uid);
    for (int p = 0; p < sampler->pad_count; p++) {
        const struct sampler_pad *pad = &sampler->pads[p];
        hello.pads[p].i2c_port = board->i2c_ports[pad->wiring.bus];
        hello.pads[p].mux_address = pad->wiring.mux_address;
        hello.pads[p].sensor_count = pad->wiring.sensor_count;
        for (int i = 0; i < pad->wiring.sensor_count; i++) {
            hello.pads[p].sensors[i].channel = pad->wiring.channels[i];
            hello.pads[p].sensors[i].state = pad->sensors[i].state;
            memcpy(hello.pads[p].sensors[i].identification, pad->sensors[i].identification, 3);
        }
    }
    send(device, line, wire_encode_hello(&hello, line));
}

static uint64_t states(const struct device *device)
{
    uint64_t packed = 0;
    for (int p = 0; p < device->sampler.pad_count; p++)
        for (int i = 0; i < device->sampler.pads[p].wiring.sensor_count; i++)
            packed = packed << 4 | device->sampler.pads[p].sensors[i].state;
    return packed;
}

static void send_status(struct device *device)
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
    device->reported_states = states(device);
    device->reported_us = status.time_us;
    device->status_us = status.time_us + STATUS_INTERVAL_US;
    send(device, line, wire_encode_status(&status, line));
}

static void send_selftest(struct device *device, uint8_t pad_index)
{
    uint8_t line[WIRE_LINE_MAX];
    const struct wire_selftest selftest = {
        .request_id = device->selftest_id,
        .pad_index = pad_index,
        .sensor_count = device->sampler.pads[pad_index].wiring.sensor_count,
        .gain_code = HMC5983_SELFTEST_GAIN,
        .sensors = device->results[pad_index],
    };
    send(device, line, wire_encode_selftest(&selftest, line));
}

static bool selftest_runs(const struct device *device)
{
    return device->selftest.active || device->selftest_waiting;
}

static enum wire_result set(struct device *device, const struct wire_request *request)
{
    struct sampler *sampler = &device->sampler;
    struct sampler_settings settings = sampler->settings;
    if (request->type == WIRE_REQUEST_RANGE) {
        if (request->argument >= HMC5983_GAIN_CODES)
            return RESULT_OUT_OF_RANGE;
        settings.gain_code = (uint8_t)request->argument;
    } else if (request->type == WIRE_REQUEST_RATE) {
        if (request->argument < 1 || request->argument > sampler_rate_max(sampler, settings.trigger))
            return RESULT_OUT_OF_RANGE;
        settings.rate_hz = request->argument;
    } else {
        if (request->argument > TRIGGER_SIMULTANEOUS)
            return RESULT_OUT_OF_RANGE;
        settings.trigger = (uint8_t)request->argument;
        uint16_t rate_max = sampler_rate_max(sampler, settings.trigger);
        if (settings.rate_hz > rate_max)
            settings.rate_hz = rate_max;
    }
    if (selftest_runs(device))
        return RESULT_BUSY;
    // A repeated request changes no setting and must not interrupt the stream.
    if (memcmp(&settings, &sampler->settings, sizeof settings) != 0)
        sampler_apply(sampler, &settings);
    return RESULT_DONE;
}

static enum wire_result begin_selftest(struct device *device, const struct wire_request *request, uint8_t pads)
{
    bool repeated = device->selftest_pads == pads && device->selftest_id == request->request_id;
    if (selftest_runs(device))
        return repeated ? RESULT_DONE : RESULT_BUSY;
    if (repeated && clock_now(&device->clock) < device->selftest_us + SELFTEST_REPEAT_US)
        return RESULT_DONE;
    device->selftest_id = request->request_id;
    device->selftest_pads = device->selftest_waiting = pads;
    return RESULT_DONE;
}

static enum wire_result execute(struct device *device, const struct wire_request *request, uint8_t pads)
{
    switch (request->type) {
    case WIRE_REQUEST_RANGE:
    case WIRE_REQUEST_RATE:
    case WIRE_REQUEST_TRIGGER:
        return set(device, request);
    case WIRE_REQUEST_START:
    case WIRE_REQUEST_STOP:
        device->running = request->type == WIRE_REQUEST_START;
        device->sampler.early = (uint8_t)request->argument;
        sampler_stream(&device->sampler, device->running && device->announced);
        return RESULT_DONE;
    case WIRE_REQUEST_SELFTEST:
        return begin_selftest(device, request, pads);
    default:
        return RESULT_DONE; // hello and status: the answer follows the reply
    }
}

static void answer(struct device *device, const struct wire_request *request)
{
    uint8_t pad_count = device->sampler.pad_count;
    bool everyone = request->pad_index == WIRE_ALL_PADS, exists = everyone || request->pad_index < pad_count;
    uint8_t pads = (uint8_t)(everyone ? (1 << pad_count) - 1 : exists ? 1 << request->pad_index : 0);
    bool had_results = !selftest_runs(device);
    struct wire_reply reply = {.request_id = request->request_id, .request_type = request->type};
    reply.result = (uint8_t)(exists ? execute(device, request, pads) : RESULT_NO_SUCH_PAD);
    uint8_t line[WIRE_LINE_MAX];
    send(device, line, wire_encode_reply(&reply, line));
    if (reply.result != RESULT_DONE)
        return;
    if (request->type == WIRE_REQUEST_HELLO) {
        device->sampler.early = 0; // a host that does not know such packets asks who is there, too
        send_hello(device);
    }
    if (request->type == WIRE_REQUEST_STATUS)
        send_status(device);
    for (uint8_t p = 0; p < pad_count && request->type == WIRE_REQUEST_SELFTEST; p++)
        if (had_results && !selftest_runs(device) && (pads >> p & 1))
            send_selftest(device, p);
}

void device_receive(struct device *device, const uint8_t *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        enum wire_event event = wire_decode(&device->decoder, bytes[i]);
        if (event == WIRE_REQUEST)
            answer(device, &device->decoder.request);
        else if (event == WIRE_BAD)
            device->receive_errors++;
    }
}

static void announce(struct device *device, uint64_t now_us)
{
    for (int p = 0; p < device->sampler.pad_count && now_us < HELLO_WAIT_US; p++)
        for (int i = 0; i < device->sampler.pads[p].wiring.sensor_count; i++)
            if (device->sampler.pads[p].sensors[i].state == SENSOR_NOT_STARTED)
                return;
    device->announced = true;
    send_hello(device);
    send_status(device);
    sampler_stream(&device->sampler, device->running);
}

static void poll_selftest(struct device *device)
{
    uint8_t pad_index = device->selftest.pad_index;
    if (device->selftest.active) {
        if (selftest_poll(&device->selftest, device->results[pad_index])) {
            device->selftest_waiting &= (uint8_t)~(1 << pad_index);
            device->selftest_us = clock_now(&device->clock);
            send_selftest(device, pad_index);
        }
        return;
    }
    for (uint8_t p = 0; p < device->sampler.pad_count; p++) {
        if (device->selftest_waiting >> p & 1) {
            selftest_start(&device->selftest, &device->sampler, p);
            return;
        }
    }
}

static bool poll_load_cell(struct device *device)
{
    const struct load_cell_pins *pins = device->board->load_cell;
    struct wire_load load = {.sequence = device->load_sequence, .time_us = clock_now(&device->clock)};
    if (!pins || !device->announced || !device->running || !load_cell_read(pins, &load.counts))
        return false;
    uint8_t line[WIRE_LINE_MAX];
    device->load_sequence++;
    send(device, line, wire_encode_load(&load, line));
    return true;
}

bool device_poll(struct device *device)
{
    bool worked = sampler_poll(&device->sampler);
    worked = poll_load_cell(device) || worked;
    poll_selftest(device);
    uint64_t now_us = clock_now(&device->clock);
    struct wire_sample frame;
    struct wire_early early;
    uint8_t line[WIRE_LINE_MAX];
    if (sampler_take_early(&device->sampler, &early))
        send(device, line, wire_encode_early(&early, line));
    while (sampler_take(&device->sampler, &frame)) {
        send(device, line, wire_encode_sample(&frame, line));
        worked = true;
    }
    if (!device->announced)
        announce(device, now_us);
    else if (now_us >= device->status_us ||
             (states(device) != device->reported_states && now_us >= device->reported_us + STATUS_PAUSE_US))
        send_status(device);
    return worked;
}
