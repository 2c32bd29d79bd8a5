// The MMC5983MA (MEMSIC data sheet rev. A, pages 11 to 18) and the MMC5603NJ (registers as Linux' driver mmc5633, Zephyr's
// mmc56x3 and Adafruit_MMC56x3 have them).
//
// Only single measurements without automatic set/reset are used. With it, a measurement takes twice its time and 1 ms
// more, ends with the film turned, and adds the scatter of a SET pulse (1 mG, page 2) to each sample; and users found
// that X of every 16th sample is wrong by 10 to 12 µT after the command 0x21 (SparkFun's library, issues 9, 10 and 12).
#include "memsic.h"

enum {
    AXES = 0x00, // Xout0 to Zout1: the upper 16 bits, high byte first; zero field is in the middle
    ZERO = 0x8000,
    STATUS_FUSES_READ = 0x10,
    RESET = 0x80,         // control 1
    BANDWIDTH_2_MS = 0x02, // control 1: a measurement takes 2 ms
};

enum bus_result memsic_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    identification[1] = identification[2] = 0;
    return chip_read(wires, wires->memsic->product, identification, 1);
}

enum bus_result memsic_reset(const struct chip_wires *wires)
{
    const uint8_t bytes[] = {(uint8_t)(wires->memsic->control_0 + 1), RESET};
    return chip_write(wires, bytes, sizeof bytes);
}

// Automatic set/reset or a magnet may have turned or upset the film before.
enum bus_result memsic_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    const uint8_t controls[] = {wires->memsic->control_0, MEMSIC_SET, BANDWIDTH_2_MS};
    (void)setup;
    return chip_write(wires, controls, sizeof controls);
}

// As far as it reports: its factory settings are loaded. Its own rate shows only in the time that a measurement takes.
enum bus_result memsic_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    uint8_t status = 0;
    enum bus_result result = chip_read(wires, wires->memsic->status, &status, 1);
    (void)setup;
    *held = status & STATUS_FUSES_READ;
    return result;
}

enum bus_result memsic_set(const struct chip_wires *wires)
{
    const uint8_t bytes[] = {wires->memsic->control_0, MEMSIC_SET};
    return chip_write(wires, bytes, sizeof bytes);
}

enum bus_result memsic_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    uint8_t status = 0;
    enum bus_result result = chip_read(wires, wires->memsic->status, &status, 1);
    sample->status = status & wires->memsic->field_done ? CHIP_READY : 0;
    return result;
}

enum bus_result memsic_read_counts(const struct chip_wires *wires, int16_t counts[3])
{
    uint8_t data[6];
    enum bus_result result = chip_read(wires, AXES, data, sizeof data);
    for (int axis = 0; axis < 3 && result == BUS_OK; axis++)
        counts[axis] = chip_limited((data[2 * axis] << 8 | data[2 * axis + 1]) - ZERO, wires->memsic->largest);
    return result;
}
