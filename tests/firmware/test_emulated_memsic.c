// The emulated MMC5983MA and MMC5603NJ against the data sheet and users' measurements, without any driver.
//
// Numbers of the MMC5983MA: MEMSIC data sheet, Rev A, pages 2, 9 and 13 to 18; DRNadler/MMC5983MA_CompassTest (automatic
// set/reset); SparkFun's library, issues 9, 10 and 12 (the sixteenth sample). Of the MMC5603NJ: Linux mmc5633, Zephyr
// mmc56x3, Adafruit_MMC56x3.
#include "../../firmware/emulated/emulated_mmc5603nj.h"
#include "../../firmware/emulated/emulated_mmc5983ma.h"

#include <math.h>
#include <string.h>

#include "harness.h"

enum { MEASURE = 0x01, SET = 0x08, RESET = 0x10, AUTOMATIC = 0x20, SOFT_RESET = 0x80 };

// The differences of the two.
struct sheet {
    uint8_t status, done, control_0;
    int bits;
    double sample_ms[4], automatic_ms[4], settles_ms, reset_ms, upsetting_gauss;
};

static const struct sheet mmc5983ma_sheet = {0x08, 0x01, 0x09, 18, {8, 4, 2, 0.5}, {17, 9, 5, 2}, 0.5, 10, 10};
static const struct sheet mmc5603nj_sheet = {0x18, 0x40, 0x1B, 20, {6.6, 3.5, 2, 1.2}, {13.2, 7, 4, 2.4}, 1, 20, 32};

static uint64_t now_ns;
static struct emulated_mmc5983ma mmc5983ma_chip;
static struct emulated_mmc5603nj mmc5603nj_chip;
static struct emulated_memsic *chip;
static const struct sheet *sheet;
static const double field[3] = {0.75, -1.5, 0.25}, after_set[3] = {0.75, -1.5, -0.25}; // left-handed, page 9

static void wait_ms(double ms)
{
    now_ns += (uint64_t)(ms * 1e6 + 0.5);
}

// Transfers take no time here: a bus's would add to the times that are checked.
static void tell(uint8_t number, uint8_t value)
{
    struct emulated_part *part = &chip->common.part;
    part->kind->advance(part, now_ns);
    part->kind->start_write(part);
    part->kind->put(part, number);
    part->kind->put(part, value);
}

static void ask(uint8_t number, uint8_t *bytes, int count)
{
    struct emulated_part *part = &chip->common.part;
    part->kind->advance(part, now_ns);
    part->kind->start_write(part);
    part->kind->put(part, number);
    for (int i = 0; i < count; i++)
        bytes[i] = part->kind->get(part);
}

static void tell_control(int number, uint8_t value)
{
    tell((uint8_t)(sheet->control_0 + number), value);
}

static bool is_done(void)
{
    uint8_t status;
    ask(sheet->status, &status, 1);
    return status & sheet->done;
}

static void look(double gauss[3])
{
    uint8_t bytes[9];
    ask(0x00, bytes, sheet->bits == 18 ? 7 : 9);
    for (int axis = 0; axis < 3; axis++) {
        int upper = bytes[2 * axis] << 8 | bytes[2 * axis + 1];
        int count = sheet->bits == 18 ? upper << 2 | (bytes[6] >> (6 - 2 * axis) & 3) : upper << 4 | bytes[6 + axis] >> 4;
        gauss[axis] = (count - (1 << (sheet->bits - 1))) / 16384.0;
    }
}

static void measure(uint8_t command, double gauss[3])
{
    tell_control(0, MEASURE | command);
    wait_ms(20);
    CHECK(is_done());
    look(gauss);
}

static bool is_field(const double gauss[3], const double due[3], double sign)
{
    return gauss[0] == sign * due[0] && gauss[1] == sign * due[1] && gauss[2] == sign * due[2];
}

static void set_field(double x, double y, double z)
{
    chip->common.part.kind->advance(&chip->common.part, now_ns);
    chip->common.field_gauss[0] = x;
    chip->common.field_gauss[1] = y;
    chip->common.field_gauss[2] = z;
}

static void pulse(uint8_t bit, double pause_ms)
{
    tell_control(0, bit);
    wait_ms(pause_ms);
}

// After SET, at bandwidth 10, with pulses that repeat exactly.
static void begin(const struct sheet *kind)
{
    sheet = kind;
    now_ns = 0;
    emulated_mmc5983ma_init(&mmc5983ma_chip, 1);
    emulated_mmc5603nj_init(&mmc5603nj_chip, 1);
    chip = kind == &mmc5983ma_sheet ? &mmc5983ma_chip.memsic : &mmc5603nj_chip.memsic;
    CHECK(chip->repeatability_gauss == 1e-3);
    chip->repeatability_gauss = 0;
    set_field(field[0], field[1], field[2]);
    wait_ms(100);
    tell_control(1, 2);
    pulse(SET, 1);
}

#define TEST_BOTH(check)                                                                                               \
    TEST(emulated_mmc5983ma_##check)                                                                                   \
    {                                                                                                                  \
        check(&mmc5983ma_sheet);                                                                                       \
    }                                                                                                                  \
    TEST(emulated_mmc5603nj_##check)                                                                                   \
    {                                                                                                                  \
        check(&mmc5603nj_sheet);                                                                                       \
    }

static void takes_the_time_of_its_bandwidth(const struct sheet *kind)
{
    double gauss[3];
    for (int automatic = 0; automatic < 2; automatic++) {
        for (uint8_t bandwidth = 0; bandwidth < 4; bandwidth++) {
            double ms = automatic ? kind->automatic_ms[bandwidth] : kind->sample_ms[bandwidth];
            begin(kind);
            tell_control(1, bandwidth);
            measure(0, gauss);
            tell_control(0, automatic ? MEASURE | AUTOMATIC : MEASURE);
            CHECK(!is_done());
            wait_ms(0.99 * ms);
            CHECK(!is_done());
            wait_ms(0.02 * ms);
            CHECK(is_done());
            wait_ms(1000);
            CHECK(is_done());
            CHECK_EQUAL(chip->common.conversions, 2);
        }
    }
}
TEST_BOTH(takes_the_time_of_its_bandwidth)

static void shows_the_old_sample_until_the_new_one_ends(const struct sheet *kind)
{
    static const double later[3] = {0.25, 0, 0};
    double gauss[3];
    begin(kind);
    measure(0, gauss);
    CHECK(is_field(gauss, after_set, 1));
    set_field(0.25, 0, 0);
    tell_control(0, MEASURE);
    wait_ms(1.9);
    look(gauss);
    CHECK(is_field(gauss, after_set, 1));
    wait_ms(0.2);
    look(gauss);
    CHECK(is_field(gauss, later, 1));
    for (int i = 0; i < 3; i++) { // a new command restarts it
        tell_control(0, MEASURE);
        wait_ms(1.9);
        CHECK(!is_done());
    }
}
TEST_BOTH(shows_the_old_sample_until_the_new_one_ends)

static uint64_t ramp_begins_ns;

// 100 G/s on x, and the other way on z.
static void ramp(const struct emulated_magnetometer *common, uint64_t ns, double gauss[3])
{
    (void)common;
    gauss[0] = 100e-9 * (double)(ns - ramp_begins_ns);
    gauss[1] = 0;
    gauss[2] = -gauss[0];
}

static void senses_the_mean_of_its_measurement(const struct sheet *kind)
{
    double gauss[3];
    begin(kind);
    ramp_begins_ns = now_ns;
    chip->common.field_at = ramp;
    tell_control(0, MEASURE);
    wait_ms(3);
    look(gauss);
    CHECK_BETWEEN(gauss[0], 0.0999, 0.1001); // at 1 ms, its middle
    CHECK_BETWEEN(gauss[2], 0.0999, 0.1001);
}
TEST_BOTH(senses_the_mean_of_its_measurement)

static void is_turned_by_pulses_with_its_zero_left(const struct sheet *kind)
{
    static const double with_zero[3] = {1.0, -1.375, -0.75}, turned[3] = {-0.5, 1.625, -0.25};
    double gauss[3];
    begin(kind);
    memcpy(chip->zero_gauss, (const double[3]){0.25, 0.125, -0.5}, sizeof chip->zero_gauss);
    measure(0, gauss);
    CHECK(is_field(gauss, with_zero, 1));
    pulse(RESET, 1);
    measure(0, gauss);
    CHECK(is_field(gauss, turned, 1));
    measure(AUTOMATIC, gauss);
    CHECK(is_field(gauss, after_set, 1));
    measure(0, gauss);
    CHECK(is_field(gauss, turned, 1)); // automatic set/reset ends with RESET
    tell_control(1, SOFT_RESET);
    wait_ms(kind->reset_ms);
    measure(0, gauss);
    CHECK(is_field(gauss, turned, 1)); // a reset contains no pulse
    chip->common.part.kind->power_on(&chip->common.part);
    measure(0, gauss);
    CHECK(is_field(gauss, turned, 1));
}
TEST_BOTH(is_turned_by_pulses_with_its_zero_left)

static void is_in_reset_polarity_when_new(const struct sheet *kind)
{
    begin(kind);
    CHECK_EQUAL(chip->polarity, 1);
    emulated_mmc5983ma_init(&mmc5983ma_chip, 1);
    emulated_mmc5603nj_init(&mmc5603nj_chip, 1);
    CHECK_EQUAL(chip->polarity, -1);
}
TEST_BOTH(is_in_reset_polarity_when_new)

static void is_wrong_soon_after_a_pulse(const struct sheet *kind)
{
    double gauss[3];
    for (int tenths = 0; tenths <= 20; tenths++) {
        double pause_ms = tenths / 10.0 * kind->settles_ms;
        begin(kind);
        pulse(SET, pause_ms);
        measure(0, gauss);
        CHECK_EQUAL(is_field(gauss, after_set, 1), tenths >= 10);
    }
    begin(kind);
    measure(SET, gauss); // both in one command
    CHECK(!is_field(gauss, after_set, 1));
    tell_control(0, MEASURE);
    wait_ms(1);
    pulse(SET, 2);
    CHECK(is_done());
    look(gauss);
    CHECK(!is_field(gauss, after_set, 1));
}
TEST_BOTH(is_wrong_soon_after_a_pulse)

static void has_a_zero_of_1_mg_from_each_pulse(const struct sheet *kind)
{
    enum { PULSES = 1000 };
    double gauss[3], again[3], squares = 0;
    begin(kind);
    chip->repeatability_gauss = 1e-3;
    for (int i = 0; i < PULSES; i++) {
        pulse(SET, 1);
        measure(0, gauss);
        measure(0, again);
        CHECK(is_field(gauss, again, 1));
        for (int axis = 0; axis < 3; axis++)
            squares += (gauss[axis] - after_set[axis]) * (gauss[axis] - after_set[axis]);
    }
    CHECK_BETWEEN(sqrt(squares / (3 * PULSES)), 0.94e-3, 1.06e-3);
}
TEST_BOTH(has_a_zero_of_1_mg_from_each_pulse)

static void is_upset_by_a_strong_field_until_a_pulse(const struct sheet *kind)
{
    static const double directions[][3] = {{1, 0, 0}, {0, -0.6, 0.8}, {0.577, 0.577, -0.577}};
    double gauss[3];
    for (int way = 0; way < 3; way++) {
        const double *way_of = directions[way];
        for (int beyond = 0; beyond < 2; beyond++) {
            double norm = kind->upsetting_gauss * (beyond ? 1.01 : 0.98);
            for (int pulsed = 0; pulsed < 2; pulsed++) {
                begin(kind);
                set_field(norm * way_of[0], norm * way_of[1], norm * way_of[2]);
                if (pulsed)
                    pulse(SET, 1); // without effect: the field is still there
                set_field(field[0], field[1], field[2]); // it remembers the field, although nothing was measured
                measure(0, gauss);
                CHECK_EQUAL(is_field(gauss, after_set, 1), !beyond);
                pulse(RESET, 1);
                measure(0, gauss);
                CHECK(is_field(gauss, after_set, -1));
            }
        }
    }
}
TEST_BOTH(is_upset_by_a_strong_field_until_a_pulse)

static void hears_nothing_while_it_starts(const struct sheet *kind)
{
    for (int late = 0; late < 2; late++) {
        begin(kind);
        tell_control(1, SOFT_RESET);
        wait_ms(kind->reset_ms - (late ? 0 : 0.1));
        tell_control(0, MEASURE);
        wait_ms(kind->sample_ms[0] - 0.1);
        CHECK(!is_done());
        wait_ms(0.2);
        CHECK_EQUAL(is_done(), late);
    }
}
TEST_BOTH(hears_nothing_while_it_starts)

static void has_the_noise_of_its_bandwidth(const struct sheet *kind)
{
    enum { SAMPLES = 1000 };
    static const double of_5983[4] = {0.4e-3, 0.6e-3, 0.8e-3, 1.2e-3};
    for (uint8_t bandwidth = 0; bandwidth < 4; bandwidth++) {
        double gauss[3], squares = 0;
        begin(kind);
        chip->common.has_own_noise = true;
        tell_control(1, bandwidth);
        for (int i = 0; i < SAMPLES; i++) {
            measure(0, gauss);
            for (int axis = 0; axis < 3; axis++)
                squares += (gauss[axis] - after_set[axis]) * (gauss[axis] - after_set[axis]);
        }
        double due = kind->bits == 18 ? of_5983[bandwidth] : 2e-3 * sqrt(kind->sample_ms[0] / kind->sample_ms[bandwidth]);
        CHECK_BETWEEN(sqrt(squares / (3 * SAMPLES)), 0.94 * due, 1.06 * due);
    }
}
TEST_BOTH(has_the_noise_of_its_bandwidth)

TEST(emulated_mmc5983ma_spoils_x_of_every_16th_sample_of_0x21)
{
    double gauss[3];
    for (int interrupt = 0; interrupt < 2; interrupt++) {
        begin(&mmc5983ma_sheet);
        for (int i = 1; i <= 64; i++) {
            measure(AUTOMATIC | (interrupt ? 0x04 : 0), gauss);
            bool odd = i % 16 == 0 && !interrupt;
            CHECK_BETWEEN(gauss[0] - after_set[0], odd ? 0.10 : 0, odd ? 0.12 : 0);
            CHECK(gauss[1] == after_set[1] && gauss[2] == after_set[2]);
        }
    }
}

static int per_second(uint8_t control_0, uint8_t bandwidth, uint8_t control_2)
{
    begin(&mmc5983ma_sheet);
    tell_control(0, control_0);
    tell_control(1, bandwidth);
    tell_control(2, control_2);
    wait_ms(1000.1);
    is_done();
    return (int)chip->common.conversions;
}

TEST(emulated_mmc5983ma_keeps_to_the_continuous_rates_of_page_16)
{
    static const int fastest_hz[4] = {50, 100, 225, 580}; // page 2
    CHECK_EQUAL(per_second(0, 0, 0x0D), 100);
    CHECK_EQUAL(per_second(0, 1, 0x0E), 200);
    CHECK_EQUAL(per_second(0, 3, 0x0F), 1000);
    CHECK_EQUAL(per_second(0, 0, 0x05), 0);
    CHECK_EQUAL(per_second(0, 0, 0x08), 0);
    for (uint8_t bandwidth = 0; bandwidth < 4; bandwidth++) {
        int most = 0;
        for (uint8_t code = 1; code < 8; code++) {
            int rate = per_second(AUTOMATIC, bandwidth, 0x88 | code);
            most = rate > most ? rate : most;
        }
        CHECK_BETWEEN(most, 0.85 * fastest_hz[bandwidth], fastest_hz[bandwidth]);
    }
}

TEST(emulated_mmc5603nj_needs_three_settings_for_continuous_measurements)
{
    static const struct {
        uint8_t rate, control_0, control_2;
        int samples;
    } cases[] = {{50, 0x80, 0x10, 50}, {255, 0x80, 0x10, 255}, {50, 0, 0x10, 0}, {50, 0x80, 0, 0}, {0, 0x80, 0x10, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        begin(&mmc5603nj_sheet);
        tell(0x1A, cases[i].rate);
        tell_control(0, cases[i].control_0);
        tell_control(2, cases[i].control_2);
        wait_ms(1000.1);
        is_done();
        CHECK_EQUAL(chip->common.conversions, cases[i].samples);
    }
}

TEST(emulated_memsic_chips_have_different_identities)
{
    uint8_t identity;
    begin(&mmc5983ma_sheet);
    ask(0x2F, &identity, 1);
    CHECK_EQUAL(identity, 0x30);
    ask(0x39, &identity, 1);
    CHECK(identity != 0x10);
    begin(&mmc5603nj_sheet);
    ask(0x39, &identity, 1);
    CHECK_EQUAL(identity, 0x10);
    ask(0x2F, &identity, 1);
    CHECK(identity != 0x30);
}
