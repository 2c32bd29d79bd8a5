// The QMC5883L (QST data sheet 13-52-04 rev. 1.0): what older boards sold as HMC5883L carry. Boards
// sold today carry the QMC5883P.
#include "chip.h"

enum {
    DATA = 0x00, // x, y, z; low byte first
    STATUS = 0x06,
    CONTROL_1 = 0x09,
    CONTROL_2 = 0x0A, // then the period of set and reset, a reserved register, and the identification
    STATUS_READY = 0x01,
    STATUS_OVERFLOW = 0x02, // an overflow of any axis: the chip does not say which
    CONTINUOUS_200_HZ = 0x0D, // control 1: 512 times oversampled, the range in bits 5–4
    ROLL_OVER_NO_INTERRUPT = 0x41,
    UNUSED_OF_CONTROL_2 = 0x3E,
    SET_RESET_PERIOD = 0x01,
    LARGEST = 32766, // beyond its range it stays at 32767 or −32768
};

static enum bus_result qmc5883l_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    uint8_t bytes[4];
    enum bus_result result = chip_read(wires, DATA, bytes, 1); // PX4 and ArduPilot read register 0 before anything else
    if (result == BUS_OK)
        result = chip_read(wires, CONTROL_2, bytes, sizeof bytes);
    identification[0] = bytes[0];
    identification[1] = bytes[1];
    identification[2] = bytes[3];
    return result;
}

// 0xFF alone may also come from a bus without any chip.
static bool qmc5883l_is_identification(const uint8_t identification[3])
{
    return identification[2] == 0xFF && identification[1] <= SET_RESET_PERIOD &&
           (identification[0] & UNUSED_OF_CONTROL_2) == 0;
}

static uint8_t control_1(const struct chip_setup *setup)
{
    return (uint8_t)(setup->gain_code << 4 | CONTINUOUS_200_HZ);
}

static enum bus_result qmc5883l_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    const uint8_t others[] = {CONTROL_2, ROLL_OVER_NO_INTERRUPT, SET_RESET_PERIOD};
    const uint8_t mode[] = {CONTROL_1, control_1(setup)};
    enum bus_result result = chip_write(wires, others, sizeof others);
    return result == BUS_OK ? chip_write(wires, mode, sizeof mode) : result;
}

static enum bus_result qmc5883l_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    uint8_t bytes[3];
    enum bus_result result = chip_read(wires, CONTROL_1, bytes, sizeof bytes);
    *held = result == BUS_OK && bytes[0] == control_1(setup) && bytes[1] == ROLL_OVER_NO_INTERRUPT &&
            bytes[2] == SET_RESET_PERIOD;
    return result;
}

static enum bus_result qmc5883l_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    uint8_t byte = 0;
    enum bus_result result = chip_read(wires, STATUS, &byte, 1);
    sample->status = byte & STATUS_READY ? CHIP_READY : 0;
    return result;
}

// An axis that shows the last count is marked; if none does although the chip reports overflow, all three are. The
// status follows the axes.
static enum bus_result qmc5883l_read_counts(const struct chip_wires *wires, int16_t counts[3])
{
    uint8_t data[STATUS + 1];
    enum bus_result result = chip_read(wires, DATA, data, sizeof data);
    if (result != BUS_OK)
        return result;
    bool untold = data[STATUS] & STATUS_OVERFLOW;
    for (int axis = 0; axis < 3; axis++) {
        counts[axis] = chip_limited((int16_t)(data[2 * axis] | data[2 * axis + 1] << 8), LARGEST);
        untold = untold && counts[axis] != CHIP_SATURATED;
    }
    for (int axis = 0; axis < 3 && untold; axis++)
        counts[axis] = CHIP_SATURATED;
    return BUS_OK;
}

static const struct chip_speed speeds[] = {{200, 5000}};

const struct chip chip_qmc5883l = {
    .gain_codes = 2,
    .speed_count = 1,
    .speeds = speeds,
    .identify = qmc5883l_identify,
    .is_identification = qmc5883l_is_identification,
    .set_up = qmc5883l_set_up,
    .check = qmc5883l_check,
    .read_status = qmc5883l_read_status,
    .read_counts = qmc5883l_read_counts,
};
