// The QMC5883L alone: its driver, where a stream shows it late or never, and its overflow flag, which no other kind has.
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
