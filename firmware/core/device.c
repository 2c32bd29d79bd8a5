#include "device.h"

#include <string.h>

#include "device_reports.h"
#include "hmc5983.h"

enum {
    STATUS_PAUSE_US = 50000, // least time between two status packets, when sensor states change
    HELLO_WAIT_US = 250000,  // the hello waits this long for sensors that were not tried yet
    SELFTEST_REPEAT_US = 5000000,
};

// Everything but the time starts as after a reset.
static void start(struct device *device, const struct board *board, struct clock clock)
{
    struct pad_wiring wiring[WIRE_PADS_MAX];
    uint8_t pad_count = pads_make(board->pads, board->pads->wanted, wiring);
    memset(device, 0, sizeof *device);
    device->board = board;
    device->clock = clock;
    device->running = true;
    device->status_us = clock_now(&device->clock) + HELLO_WAIT_US;
    sampler_init(&device->sampler, &device->clock, board->buses, board->bus_count, wiring, pad_count);
}

void device_init(struct device *device, const struct board *board)
{
    start(device, board, (struct clock){.now_us = board->now_us, .context = board->context});
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

// Notes which pads a hello request asks for, if they differ from the present ones.
static enum wire_result want_pads(struct device *device, uint16_t wanted)
{
    const struct sampler *sampler = &device->sampler;
    struct pad_wiring wiring[WIRE_PADS_MAX];
    uint8_t count = pads_make(device->board->pads, wanted, wiring);
    if (count == 0)
        return RESULT_OUT_OF_RANGE;
    bool other = count != sampler->pad_count;
    for (int p = 0; p < count; p++)
        other |= wiring[p].sensor_count != sampler->pads[p].wiring.sensor_count;
    if (other && selftest_runs(device))
        return RESULT_BUSY;
    device->wanted_pads = other ? wanted : 0;
    return RESULT_DONE;
}

// The hello follows once every sensor was tried.
static void make_pads(struct device *device)
{
    device->board->pads->wanted = device->wanted_pads;
    pads_seal(device->board->pads);
    start(device, device->board, device->clock);
}

static enum wire_result execute(struct device *device, const struct wire_request *request, uint8_t pads)
{
    switch (request->type) {
    case WIRE_REQUEST_HELLO:
        return request->argument ? want_pads(device, request->argument) : RESULT_DONE;
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
        return RESULT_DONE; // a status is sent after the reply
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
    device_send(device, line, wire_encode_reply(&reply, line));
    if (reply.result != RESULT_DONE)
        return;
    if (device->wanted_pads) {
        make_pads(device); // the reset discards the request, too
        return;
    }
    if (request->type == WIRE_REQUEST_HELLO) {
        device->sampler.early = 0; // a host that does not know these packets asks for a hello, too
        device_send_hello(device);
    }
    if (request->type == WIRE_REQUEST_STATUS)
        device_send_status(device);
    for (uint8_t p = 0; p < pad_count && request->type == WIRE_REQUEST_SELFTEST; p++)
        if (had_results && !selftest_runs(device) && (pads >> p & 1))
            device_send_selftest(device, p);
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
    for (int i = 0; i < device->sampler.sensor_count && now_us < device->status_us; i++)
        if (device->sampler.sensors[i].state == SENSOR_NOT_STARTED)
            return;
    device->announced = true;
    device_send_hello(device);
    device_send_status(device);
    sampler_stream(&device->sampler, device->running);
}

static void poll_selftest(struct device *device)
{
    uint8_t pad_index = device->selftest.pad_index;
    if (device->selftest.active) {
        if (selftest_poll(&device->selftest, device_results_of(device, pad_index))) {
            device->selftest_waiting &= (uint8_t)~(1 << pad_index);
            device->selftest_us = clock_now(&device->clock);
            device_send_selftest(device, pad_index);
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
    device_send(device, line, wire_encode_load(&load, line));
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
        device_send(device, line, wire_encode_early(&early, line));
    while (sampler_take(&device->sampler, &frame)) {
        device_send(device, line, wire_encode_sample(&frame, line));
        worked = true;
    }
    if (!device->announced)
        announce(device, now_us);
    else if (now_us >= device->status_us ||
             (device_states(device) != device->reported_states && now_us >= device->reported_us + STATUS_PAUSE_US))
        device_send_status(device);
    return worked;
}
