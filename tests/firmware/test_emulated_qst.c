// The emulated QMC5883L, QMC5883P and MLX90393 against what public drivers and a data sheet say, without any driver.
//
// QMC5883L: PX4 qmc5883l, ArduPilot AP_Compass_QMC5883L. QMC5883P: ArduPilot AP_Compass_QMC5883P, Adafruit_QMC5883P,
// reznikmm/qmc5883p. MLX90393: Melexis 3901090393 rev. 002, pages 13 and 16; Adafruit_MLX90393, issues 17 and 18.
#include "../../firmware/emulated/emulated_mlx90393.h"
#include "../../firmware/emulated/emulated_qmc5883l.h"
#include "../../firmware/emulated/emulated_qmc5883p.h"

#include <math.h>
#include <string.h>

#include "harness.h"

static uint64_t now_ns;
static struct emulated_qmc5883l qmc5883l_chip;
static struct emulated_qmc5883p qmc5883p_chip;
static struct emulated_mlx90393 mlx90393_chip;

static void wait_ms(double ms)
{
    now_ns += (uint64_t)(ms * 1e6 + 0.5);
}

// Transfers take no time here: a bus's would add to the times that are checked.
static void write_bytes(struct emulated_part *part, const uint8_t *bytes, size_t count)
{
    part->kind->advance(part, now_ns);
    part->kind->start_write(part);
    for (size_t i = 0; i < count; i++)
        part->kind->put(part, bytes[i]);
}

#define WRITE(chip, ...) write_bytes(&(chip).common.part, (const uint8_t[]){__VA_ARGS__}, sizeof(uint8_t[]){__VA_ARGS__})

static void read_bytes(struct emulated_part *part, uint8_t *bytes, size_t count)
{
    part->kind->advance(part, now_ns);
    for (size_t i = 0; i < count; i++)
        bytes[i] = part->kind->get(part);
}

static uint8_t register_of(struct emulated_part *part, uint8_t number)
{
    uint8_t byte;
    write_bytes(part, &number, 1);
    read_bytes(part, &byte, 1);
    return byte;
}

static void set_field(struct emulated_magnetometer *chip, double x, double y, double z)
{
    chip->part.kind->advance(&chip->part, now_ns);
    chip->field_gauss[0] = x;
    chip->field_gauss[1] = y;
    chip->field_gauss[2] = z;
}

// -- QMC5883L --

TEST(emulated_qmc5883l_has_no_identity_before_register_0_was_read)
{
    struct emulated_part *part = &qmc5883l_chip.common.part;
    emulated_qmc5883l_init(&qmc5883l_chip, 1);
    CHECK_EQUAL(register_of(part, 0x0D), 0x00);
    register_of(part, 0x00);
    CHECK_EQUAL(register_of(part, 0x0D), 0xFF);
    WRITE(qmc5883l_chip, 0x0A, 0x80);
    CHECK_EQUAL(register_of(part, 0x0D), 0xFF);
    part->kind->power_on(part);
    CHECK_EQUAL(register_of(part, 0x0D), 0x00);
}

TEST(emulated_qmc5883l_takes_commands_of_an_mlx90393_as_registers)
{
    uint8_t byte;
    emulated_qmc5883l_init(&qmc5883l_chip, 1);
    WRITE(qmc5883l_chip, 0x09, 0x0D);
    WRITE(qmc5883l_chip, 0x80);
    CHECK_EQUAL(qmc5883l_chip.common.pointer, 0x80);
    read_bytes(&qmc5883l_chip.common.part, &byte, 1);
    CHECK_EQUAL(byte, 0);
    WRITE(qmc5883l_chip, 0x50, 0x00);
    CHECK_EQUAL(qmc5883l_chip.common.pointer, 0x51);
    CHECK_EQUAL(register_of(&qmc5883l_chip.common.part, 0x09), 0x0D);
}

// -- QMC5883P --

enum { STATUS = 0x09, CONTROL_1 = 0x0A, CONTROL_2 = 0x0B, SIGNS = 0x29, READY = 1, OVERFLOWN = 2, NORMAL = 1, SINGLE = 2 };

static void begin_qmc5883p(uint8_t range_code, uint8_t mode)
{
    now_ns = 0;
    emulated_qmc5883p_init(&qmc5883p_chip, 1);
    set_field(&qmc5883p_chip.common, 0.75, -1.5, 0.3);
    WRITE(qmc5883p_chip, SIGNS, 0x06);
    WRITE(qmc5883p_chip, CONTROL_2, (uint8_t)(range_code << 2));
    WRITE(qmc5883p_chip, CONTROL_1, 3 << 2 | mode);
}

static void check_qmc5883p_counts(int x, int y, int z)
{
    const int due[3] = {x, y, z};
    uint8_t bytes[6];
    WRITE(qmc5883p_chip, 0x01);
    read_bytes(&qmc5883p_chip.common.part, bytes, 6);
    for (int axis = 0; axis < 3; axis++)
        CHECK_EQUAL((int16_t)(bytes[2 * axis] | bytes[2 * axis + 1] << 8), due[axis]);
}

static uint8_t qmc5883p_status(void)
{
    return register_of(&qmc5883p_chip.common.part, STATUS);
}

TEST(emulated_qmc5883p_has_its_identity_and_scales)
{
    static const int lsb[4] = {1000, 2500, 3750, 15000};
    for (uint8_t code = 0; code < 4; code++) {
        begin_qmc5883p(code, SINGLE);
        CHECK_EQUAL(qmc5883p_chip.common.part.address, 0x2C);
        CHECK_EQUAL(register_of(&qmc5883p_chip.common.part, 0x00), 0x80);
        wait_ms(5.1);
        check_qmc5883p_counts((int)lround(0.75 * lsb[code]), (int)lround(-1.5 * lsb[code]), (int)lround(0.3 * lsb[code]));
        CHECK_EQUAL(register_of(&qmc5883p_chip.common.part, CONTROL_1) & 3, 0); // it ends in suspend
        wait_ms(1000);
        qmc5883p_status();
        CHECK_EQUAL(qmc5883p_chip.common.conversions, 1);
    }
}

TEST(emulated_qmc5883p_keeps_its_rate)
{
    static const int rate_hz[4] = {10, 50, 100, 200};
    for (uint8_t code = 0; code < 4; code++) {
        begin_qmc5883p(3, 0);
        WRITE(qmc5883p_chip, CONTROL_1, (uint8_t)(code << 2 | NORMAL));
        wait_ms(990.0 / rate_hz[code]);
        CHECK_EQUAL(qmc5883p_status(), 0);
        wait_ms(20.0 / rate_hz[code]);
        CHECK_EQUAL(qmc5883p_status(), READY);
        wait_ms(1000);
        qmc5883p_status();
        CHECK_EQUAL(qmc5883p_chip.common.conversions, rate_hz[code] + 1);
        WRITE(qmc5883p_chip, CONTROL_1, 0);
        wait_ms(1000);
        qmc5883p_status();
        CHECK_EQUAL(qmc5883p_chip.common.conversions, rate_hz[code] + 1);
    }
}

TEST(emulated_qmc5883p_clears_ready_by_the_status_or_by_the_data)
{
    for (int by_data = 0; by_data < 2; by_data++) {
        begin_qmc5883p(3, SINGLE);
        qmc5883p_chip.cleared_by_data = by_data;
        wait_ms(5.1);
        CHECK_EQUAL(qmc5883p_status(), READY);
        CHECK_EQUAL(qmc5883p_status(), by_data ? READY : 0);
        check_qmc5883p_counts(11250, -22500, 4500);
        CHECK_EQUAL(qmc5883p_status(), 0);
    }
}

TEST(emulated_qmc5883p_overflows_beyond_30000_counts_and_saturates)
{
    static const struct {
        double gauss;
        int counts;
        bool overflows;
    } cases[] = {{1.99, 29850, false}, {2.01, 30150, true}, {-2.5, -32768, true}, {9, 32767, true}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        begin_qmc5883p(3, SINGLE);
        set_field(&qmc5883p_chip.common, 0.5, cases[i].gauss, 0.5);
        wait_ms(5.1);
        check_qmc5883p_counts(7500, cases[i].counts, 7500);
        CHECK_EQUAL(qmc5883p_status() & OVERFLOWN, cases[i].overflows ? OVERFLOWN : 0);
        CHECK_EQUAL(qmc5883p_status() & OVERFLOWN, 0); // "cleared after this bit is read"
    }
}

TEST(emulated_qmc5883p_has_turned_axes_before_its_signs_are_defined)
{
    begin_qmc5883p(3, NORMAL);
    WRITE(qmc5883p_chip, CONTROL_2, 0x80); // a soft reset: suspend, ±30 G, signs undefined
    CHECK_EQUAL(register_of(&qmc5883p_chip.common.part, CONTROL_1), 0);
    wait_ms(1000);
    CHECK_EQUAL(qmc5883p_status(), 0);
    WRITE(qmc5883p_chip, SIGNS, 0x05);
    WRITE(qmc5883p_chip, CONTROL_2, 3 << 2);
    WRITE(qmc5883p_chip, CONTROL_1, SINGLE);
    wait_ms(5.1);
    check_qmc5883p_counts(-11250, 22500, 4500);
    WRITE(qmc5883p_chip, SIGNS, 0x06);
    CHECK_EQUAL(register_of(&qmc5883p_chip.common.part, SIGNS), 0); // it cannot be read back
    WRITE(qmc5883p_chip, CONTROL_1, SINGLE);
    wait_ms(5.1);
    check_qmc5883p_counts(11250, -22500, 4500);
}

// -- MLX90393 --

enum { BURST = 0x1F, SINGLE_OF_ALL = 0x3F, READ_ALL = 0x4F, EXIT = 0x80, RESET = 0xF0, ERROR = 0x10 };
static const double axis_ms = (67 + 64 * 10) * 1e-3; // DIG_FILT 3, OSR 0

static uint8_t mlx90393_answer(uint8_t command)
{
    uint8_t status;
    WRITE(mlx90393_chip, command);
    read_bytes(&mlx90393_chip.common.part, &status, 1);
    return status;
}

static void set_up_mlx90393(void)
{
    mlx90393_answer(EXIT);
    wait_ms(1);
    WRITE(mlx90393_chip, 0x60, 0x06, 0x7C, 0 << 2); // the factory's bits, GAIN_SEL 7, HALLCONF 0xC
    WRITE(mlx90393_chip, 0x60, 0x05, 0x4C, 2 << 2); // RES 2, DIG_FILT 3, OSR 0
}

static void begin_mlx90393(void)
{
    now_ns = 0;
    emulated_mlx90393_init(&mlx90393_chip, 0x0C, 1);
    set_field(&mlx90393_chip.common, 1, 2, 1);
    set_up_mlx90393();
}

// Counts from the middle, in µT.
static void mlx90393_fields(uint8_t start, bool reads_status, double ut[3])
{
    static const double step_ut[3] = {0.601, 0.601, 0.968};
    uint8_t bytes[9];
    if (reads_status)
        mlx90393_answer(start);
    else
        WRITE(mlx90393_chip, start);
    wait_ms(20);
    WRITE(mlx90393_chip, READ_ALL);
    read_bytes(&mlx90393_chip.common.part, bytes, 9);
    CHECK_EQUAL(bytes[0] & ERROR, 0);
    for (int axis = 0; axis < 3; axis++)
        ut[axis] = step_ut[axis] * ((bytes[3 + 2 * axis] << 8 | bytes[4 + 2 * axis]) - 0x8000);
}

static bool mlx90393_is_right(uint8_t start, bool reads_status)
{
    double ut[3];
    set_up_mlx90393();
    mlx90393_fields(start, reads_status, ut);
    return fabs(ut[0] - 100) < 1 && fabs(ut[1] - 200) < 1 && fabs(ut[2] - 100) < 1;
}

TEST(emulated_mlx90393_needs_the_status_of_the_first_start_read)
{
    for (int begun = 0; begun < 6; begun++) {
        uint8_t start = begun % 2 ? BURST : SINGLE_OF_ALL;
        begin_mlx90393();
        if (begun >= 2) {
            CHECK(mlx90393_is_right(start, true));
            if (begun < 4)
                mlx90393_answer(RESET);
            else
                mlx90393_chip.common.part.kind->power_on(&mlx90393_chip.common.part);
        }
        CHECK(!mlx90393_is_right(start, false));
        CHECK(!mlx90393_is_right(start, false));
        CHECK(mlx90393_is_right(start, true));
        CHECK(mlx90393_is_right(start, false));
    }
}

TEST(emulated_mlx90393_may_be_slower_than_its_table)
{
    const double table_ms = 3 * axis_ms + (67 + 192 + 490) * 1e-3;
    static const double slowness[] = {1.0, 1.25};
    for (int i = 0; i < 2; i++) {
        begin_mlx90393();
        mlx90393_chip.slowness = slowness[i];
        mlx90393_answer(SINGLE_OF_ALL);
        wait_ms(0.99 * slowness[i] * table_ms);
        CHECK(mlx90393_answer(READ_ALL) & ERROR);
        wait_ms(0.02 * slowness[i] * table_ms);
        CHECK(!(mlx90393_answer(READ_ALL) & ERROR));
    }
}

static uint64_t ramp_begins_ns;

static void ramp(const struct emulated_magnetometer *common, uint64_t ns, double gauss[3])
{
    (void)common;
    gauss[0] = gauss[1] = gauss[2] = 1000e-9 * (double)(ns - ramp_begins_ns); // 1000 G/s
}

TEST(emulated_mlx90393_measures_its_axes_one_after_the_other)
{
    double ut[3];
    begin_mlx90393();
    ramp_begins_ns = now_ns;
    mlx90393_chip.common.field_at = ramp;
    mlx90393_fields(SINGLE_OF_ALL, true, ut);
    CHECK_BETWEEN((ut[1] - ut[0]) / 100, axis_ms - 0.02, axis_ms + 0.02); // one gauss stands for one millisecond here
    CHECK_BETWEEN((ut[2] - ut[1]) / 100, axis_ms - 0.02, axis_ms + 0.02);
    CHECK_BETWEEN(ut[0] / 100, 0.5 * axis_ms, 3 * axis_ms);
}
