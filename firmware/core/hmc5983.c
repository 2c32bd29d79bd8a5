#include "hmc5983.h"

const uint16_t hmc5983_lsb_per_gauss[HMC5983_GAIN_CODES] = {1370, 1090, 820, 660, 440, 390, 330, 230};

// Data sheet, self-test limits at gain 5.
enum { SELFTEST_MIN = 243, SELFTEST_MAX = 575 };

static uint8_t config_a(const struct hmc5983_config *config)
{
    return (uint8_t)(HMC5983_TEMPERATURE_COMPENSATION | HMC5983_RATE_220_HZ | config->bias);
}

static uint8_t config_b(const struct hmc5983_config *config)
{
    return (uint8_t)(config->gain_code << 5);
}

static int16_t big_endian(const uint8_t *bytes)
{
    return (int16_t)(bytes[0] << 8 | bytes[1]);
}

enum bus_result hmc5983_identify(const struct bus *bus, uint8_t identification[3])
{
    return bus->read_register(bus->context, HMC5983_ADDRESS, HMC5983_IDENTIFICATION, identification, 3);
}

bool hmc5983_is_identification(const uint8_t identification[3])
{
    return identification[0] == 'H' && identification[1] == '4' && identification[2] == '3';
}

enum bus_result hmc5983_configure(const struct bus *bus, const struct hmc5983_config *config)
{
    const uint8_t registers[] = {HMC5983_CONFIG_A, config_a(config), config_b(config), config->mode};
    return bus->write(bus->context, HMC5983_ADDRESS, registers, sizeof registers);
}

enum bus_result hmc5983_verify(const struct bus *bus, const struct hmc5983_config *config, bool *held)
{
    uint8_t registers[2];
    enum bus_result result =
        bus->read_register(bus->context, HMC5983_ADDRESS, HMC5983_CONFIG_A, registers, sizeof registers);
    *held = result == BUS_OK && registers[0] == config_a(config) && registers[1] == config_b(config);
    return result;
}

enum bus_result hmc5983_trigger(const struct bus *bus)
{
    const uint8_t single[] = {HMC5983_MODE, HMC5983_SINGLE};
    return bus->write(bus->context, HMC5983_ADDRESS, single, sizeof single);
}

enum bus_result hmc5983_read_status(const struct bus *bus, uint8_t *status)
{
    return bus->read_register(bus->context, HMC5983_ADDRESS, HMC5983_STATUS, status, 1);
}

enum bus_result hmc5983_read(const struct bus *bus, int16_t counts[3])
{
    uint8_t data[6];
    enum bus_result result = bus->read_register(bus->context, HMC5983_ADDRESS, HMC5983_DATA, data, sizeof data);
    if (result == BUS_OK) {
        counts[0] = big_endian(data);
        counts[2] = big_endian(data + 2);
        counts[1] = big_endian(data + 4);
    }
    return result;
}

enum bus_result hmc5983_read_temperature(const struct bus *bus, int16_t *raw)
{
    uint8_t data[2];
    enum bus_result result = bus->read_register(bus->context, HMC5983_ADDRESS, HMC5983_TEMPERATURE, data, sizeof data);
    if (result == BUS_OK)
        *raw = big_endian(data);
    return result;
}

static bool within_limits(int counts)
{
    return counts >= SELFTEST_MIN && counts <= SELFTEST_MAX;
}

static int magnitude(int counts)
{
    return counts < 0 ? -counts : counts;
}

// According to the data sheet the chip subtracts the external field itself, so that positive and negative are symmetric
// about zero. On a chip that does not, they are symmetric about the unbiased reading. The nearer of the two is
// subtracted, so that either kind is judged by its strap alone, and a dead strap fails on both.
static int external_field(int unbiased, int positive, int negative)
{
    int centre = (positive + negative) / 2;
    return magnitude(centre - unbiased) < magnitude(centre) ? unbiased : 0;
}

void hmc5983_judge_selftest(const int16_t unbiased[3], const int16_t positive[3], const int16_t negative[3],
                            struct wire_selftest_sensor *result)
{
    result->state = SENSOR_OK;
    for (int axis = 0; axis < 3; axis++) {
        bool saturated = unbiased[axis] == HMC5983_OVERFLOW || positive[axis] == HMC5983_OVERFLOW ||
                         negative[axis] == HMC5983_OVERFLOW;
        int external = external_field(unbiased[axis], positive[axis], negative[axis]);
        int up = saturated ? HMC5983_OVERFLOW : positive[axis] - external;
        int down = saturated ? HMC5983_OVERFLOW : negative[axis] - external;
        result->positive[axis] = (int16_t)up;
        result->negative[axis] = (int16_t)down;
        if (!within_limits(up) || !within_limits(-down))
            result->state = SENSOR_SELFTEST_FAILED;
    }
}
