#include "selftest.h"

#include <string.h>

#include "hmc5983.h"
#include "simultaneous.h"

enum { STAGE_CONFIGURE, STAGE_TRIGGER, STAGE_READ };

enum {
    ROUNDS_DISCARDED = 1, // the chips convert this round with the old gain
    ROUNDS = ROUNDS_DISCARDED + 4,
    // A biased measurement is two acquisitions, one without and one with the strap (data sheet, self-test operation).
    ROUND_WAIT_US = 2 * HMC5983_SINGLE_CONVERSION_US + 500,
    SATURATED = INT16_MIN,
};

void selftest_start(struct selftest *selftest, struct sampler *sampler, uint8_t pad_index)
{
    struct sampler_pad *pad = &sampler->pads[pad_index];
    *selftest = (struct selftest){.sampler = sampler, .active = true, .pad_index = pad_index};
    pad->borrowed = true;
    simultaneous_forget(pad);
    for (int i = 0; i < pad->wiring.sensor_count; i++)
        selftest->state[i] = sensor_chip(&pad->sensors[i])->has_strap ? pad->sensors[i].state : SENSOR_SELFTEST_FAILED;
}

static struct sampler_pad *pad_of(const struct selftest *selftest)
{
    return &selftest->sampler->pads[selftest->pad_index];
}

static uint8_t channels_under_test(const struct selftest *selftest)
{
    const struct pad_wiring *wiring = &pad_of(selftest)->wiring;
    uint8_t channels = 0;
    for (int i = 0; i < wiring->sensor_count; i++)
        if (selftest->state[i] == SENSOR_OK)
            channels |= pad_bus_channel(wiring, i);
    return channels;
}

static enum bus_result configure(struct selftest *selftest, const struct bus *bus)
{
    static const uint8_t biases[SELFTEST_BIASES] = {HMC5983_BIAS_NONE, HMC5983_BIAS_POSITIVE, HMC5983_BIAS_NEGATIVE};
    const struct hmc5983_config config = {HMC5983_SELFTEST_GAIN, biases[selftest->bias], HMC5983_IDLE};
    bool held = false;
    enum bus_result result = hmc5983_configure(bus, &config);
    if (result == BUS_OK)
        result = hmc5983_verify(bus, &config, &held);
    if (result == BUS_OK && !held)
        selftest->state[selftest->sensor] = SENSOR_CONFIG_NOT_HELD;
    return result;
}

static enum bus_result read(struct selftest *selftest, const struct bus *bus)
{
    uint8_t status = 0;
    int16_t counts[3];
    enum bus_result result = hmc5983_read_status(bus, &status);
    if (result == BUS_OK)
        result = hmc5983_read(bus, counts);
    if (result != BUS_OK)
        return result;
    if (!(status & HMC5983_READY))
        selftest->state[selftest->sensor] = SENSOR_NO_NEW_DATA;
    int16_t *sums = selftest->sums[selftest->sensor][selftest->bias];
    for (int axis = 0; axis < 3 && selftest->round >= ROUNDS_DISCARDED; axis++) {
        if (counts[axis] == HMC5983_OVERFLOW || sums[axis] == SATURATED)
            sums[axis] = SATURATED;
        else
            sums[axis] = (int16_t)(sums[axis] + counts[axis]);
    }
    return BUS_OK;
}

// One sensor's part of a stage. From then on it skips a sensor that fails; the others continue.
static void visit(struct selftest *selftest)
{
    struct sampler *sampler = selftest->sampler;
    struct sampler_pad *pad = pad_of(selftest);
    const struct bus *bus = sampler->buses[pad->wiring.bus].route.bus;
    if (selftest->state[selftest->sensor] != SENSOR_OK)
        return;
    enum bus_result result = pad_bus_reach(sampler, pad, pad_bus_channel(&pad->wiring, selftest->sensor));
    if (result == BUS_NO_ANSWER)
        selftest->state[selftest->sensor] = SENSOR_MUX_NO_ANSWER;
    if (result == BUS_OK) {
        result = selftest->stage == STAGE_CONFIGURE ? configure(selftest, bus) : read(selftest, bus);
        if (result == BUS_NO_ANSWER)
            selftest->state[selftest->sensor] = SENSOR_NO_ANSWER;
    }
    if (result != BUS_OK && result != BUS_NO_ANSWER)
        selftest->state[selftest->sensor] = SENSOR_BUS_STUCK;
    pad_bus_account(sampler, pad, NULL, result);
}

static void trigger(struct selftest *selftest)
{
    struct sampler *sampler = selftest->sampler;
    struct sampler_pad *pad = pad_of(selftest);
    uint8_t channels = channels_under_test(selftest);
    if (channels) {
        enum bus_result result = pad_bus_reach(sampler, pad, channels);
        if (result == BUS_OK)
            result = hmc5983_trigger(sampler->buses[pad->wiring.bus].route.bus);
        pad_bus_account(sampler, pad, NULL, result);
    }
    selftest->due_us = clock_now(sampler->clock) + (channels ? ROUND_WAIT_US : 0);
}

static void mean(const int16_t sums[3], int16_t means[3])
{
    const int samples = ROUNDS - ROUNDS_DISCARDED;
    for (int axis = 0; axis < 3; axis++) {
        int rounding = sums[axis] < 0 ? -samples / 2 : samples / 2;
        means[axis] = (int16_t)(sums[axis] == SATURATED ? HMC5983_OVERFLOW : (sums[axis] + rounding) / samples);
    }
}

static void finish(struct selftest *selftest, struct wire_selftest_sensor *results)
{
    struct sampler_pad *pad = pad_of(selftest);
    uint64_t now_us = clock_now(selftest->sampler->clock);
    for (int i = 0; i < pad->wiring.sensor_count; i++) {
        int16_t means[SELFTEST_BIASES][3];
        results[i] = (struct wire_selftest_sensor){.state = selftest->state[i]};
        for (int bias = 0; bias < SELFTEST_BIASES; bias++)
            mean(selftest->sums[i][bias], means[bias]);
        if (selftest->state[i] == SENSOR_OK)
            hmc5983_judge_selftest((const int16_t *)means[0], means[1], means[2], &results[i]);
        sensor_reconfigure(&pad->sensors[i], now_us);
    }
    pad->borrowed = false;
    selftest->active = false;
}

static void next_stage(struct selftest *selftest)
{
    selftest->sensor = 0;
    if (selftest->stage != STAGE_READ) {
        selftest->stage++;
    } else if (++selftest->round < ROUNDS) {
        selftest->stage = STAGE_TRIGGER;
    } else {
        selftest->round = 0;
        selftest->stage = STAGE_CONFIGURE;
        selftest->bias++;
    }
}

bool selftest_poll(struct selftest *selftest, struct wire_selftest_sensor results[PAD_SENSORS_MAX])
{
    if (!selftest->active || clock_now(selftest->sampler->clock) < selftest->due_us)
        return false;
    if (selftest->bias == SELFTEST_BIASES) {
        finish(selftest, results);
        return true;
    }
    if (selftest->stage == STAGE_TRIGGER) {
        trigger(selftest);
        next_stage(selftest);
        return false;
    }
    visit(selftest);
    if (++selftest->sensor >= pad_of(selftest)->wiring.sensor_count)
        next_stage(selftest);
    return false;
}
