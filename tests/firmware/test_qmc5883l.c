// The QMC5883L alone: its driver where a stream shows errors late or never, and its overflow flag, which no other kind
// has.
#include "../../firmware/core/chips/chip.h"
#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/emulated_qmc5883l.h"
#include "chip_bench.h"
#include "chip_rig.h"
#include "harness.h"

static struct emulated_qmc5883l chip;
static const struct chip_wires wires = {.bus = &bench.buses[0], .address = 0x0D};
static const struct chip_setup streaming = {.gain_code = 1, .streams = true};

static bool is_set_up(void)
{
    bool held = false;
    CHECK_EQUAL(chip_qmc5883l.check(&wires, &streaming, &held), BUS_OK);
    return held;
}

TEST(qmc5883l_is_told_by_its_identification_and_by_bits_that_it_does_not_use)
{
    static const uint8_t reset[3] = {0, 0, 0xFF}, set_up[3] = {0x41, 1, 0xFF}, nobody[3] = {0xFF, 0xFF, 0xFF},
                         zeros[3] = {0, 0, 0}, other[3] = {0, 0, 0xFE};
    CHECK(chip_qmc5883l.is_identification(reset));
    CHECK(chip_qmc5883l.is_identification(set_up));
    CHECK(!chip_qmc5883l.is_identification(nobody)); // a bus that nobody drives
    CHECK(!chip_qmc5883l.is_identification(zeros));
    CHECK(!chip_qmc5883l.is_identification(other));
}

TEST(qmc5883l_is_set_up_as_its_data_sheet_says_and_check_sees_every_bit)
{
    bench_init(&bench);
    emulated_qmc5883l_init(&chip, 1);
    bench_add_switch(&bench, 0, SWITCH)->chips[0] = &chip.common.part;
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 1), BUS_OK);
    CHECK_EQUAL(chip_qmc5883l.set_up(&wires, &streaming), BUS_OK);
    chip.common.clock_stopped = true;
    CHECK_EQUAL(chip.common.registers[0x09], 0x1D); // 512 times, 8 G, 200 Hz, continuous (section 9.2.3)
    CHECK_EQUAL(chip.common.registers[0x0A], 0x41); // section 9.2.4
    CHECK_EQUAL(chip.common.registers[0x0B], 0x01); // recommended (section 9.2.5)
    for (int number = 0x09; number <= 0x0B; number++) {
        for (int bit = 0; bit < 8; bit++) {
            CHECK(is_set_up());
            chip.common.registers[number] ^= (uint8_t)(1 << bit);
            CHECK(!is_set_up());
            chip.common.registers[number] ^= (uint8_t)(1 << bit);
        }
    }
}

static void check_marked(bool marked)
{
    rig_run_ms(100);
    struct sample_view view = chip_rig_newest();
    CHECK_EQUAL(view.valid, 15);
    for (int i = 0; i < 4; i++)
        for (int axis = 0; axis < 3; axis++)
            CHECK_EQUAL(view.counts[i][axis] == INT16_MIN, i == 2 && marked);
    for (int i = 0; i < 4; i++)
        if (i != 2 || !marked)
            chip_rig_check_counts(&qmc5883l, &view, i);
}

TEST(qmc5883l_marks_all_axes_where_its_overflow_flag_does_not_tell_which)
{
    chip_rig_begin_streaming(&qmc5883l, 1, 200);
    others[0][2].qmc5883l.overflow_gauss = 8; // the end of its range, at 24000 counts
    for (int axis = 0; axis < 3; axis++) {
        for (int sign = -1; sign <= 1; sign += 2) {
            double field[3] = {0.5, 0.5, 0.5};
            field[axis] = 7.9 * sign;
            chip_rig_set_field(2, field[0], field[1], field[2]);
            check_marked(false);
            field[axis] = 8.1 * sign;
            chip_rig_set_field(2, field[0], field[1], field[2]);
            check_marked(true);
        }
    }
    chip_rig_set_field(2, 0.5, 0.5, 0.5);
    check_marked(false);
}

static int commands_of_an_mlx90393;

static void put_and_count(struct emulated_part *part, uint8_t byte)
{
    commands_of_an_mlx90393 += ((struct emulated_magnetometer *)part)->pointer_expected && (byte == 0x80 || byte == 0x50);
    others[0][0].common.part.kind->put(part, byte);
}

// An MLX90393 may be at 0x0D, too; the search for one writes register 0x50 of this chip.
TEST(qmc5883l_that_is_misread_once_is_not_asked_by_writing)
{
    static struct emulated_part_kind counting;
    struct emulated_magnetometer *misread = &others[0][1].common;
    chip_rig_begin(&qmc5883l, 1);
    counting = *misread->part.kind;
    counting.put = put_and_count;
    commands_of_an_mlx90393 = 0;
    misread->registers[0x0D] = 0xFE;
    misread->part.kind = &counting;
    for (int step = 0; step < 200; step++) {
        rig_run_ms(0.02);
        if (rig.emulation.device.sampler.pads[0].sensors[1].doubts)
            misread->registers[0x0D] = 0xFF;
    }
    CHECK_EQUAL(misread->registers[0x0D], 0xFF);
    CHECK_EQUAL(commands_of_an_mlx90393, 0);
    rig_run_ms(100);
    CHECK_EQUAL(rig.emulation.device.sampler.pads[0].sensors[1].state, SENSOR_OK);
}
