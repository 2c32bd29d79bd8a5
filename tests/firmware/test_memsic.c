// The MMC5983MA and the MMC5603NJ on a board: which measurement a sample belongs to, when it was, and the effect of a
// strong field.
// FMFTS_FRAMES: the number of frames in the first test, 2000 if it is not set.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "chip_rig.h"
#include "harness.h"

#define TEST_EACH_MEMSIC(check)                                                                                        \
    TEST(mmc5983ma_##check)                                                                                            \
    {                                                                                                                  \
        check(&mmc5983ma);                                                                                             \
    }                                                                                                                  \
    TEST(mmc5603nj_##check)                                                                                            \
    {                                                                                                                  \
        check(&mmc5603nj);                                                                                             \
    }

// Each measurement has a number, which x and y show with opposite signs.
enum { NUMBERS = 1000, STEP = 2, US_WORST = 200 };

static uint64_t (*own_convert)(struct emulated_magnetometer *chip);
static uint64_t middle_ns[PAD_SENSORS_FOUND][NUMBERS];

static struct emulated_memsic *film(int sensor)
{
    return (struct emulated_memsic *)&others[0][sensor].common;
}

static struct sampler_pad *pad(void)
{
    return &rig.emulation.device.sampler.pads[0];
}

// S p. 15: the 2 ms of a measurement end now. (The emulated chip is not asked when it began.)
static uint64_t convert_numbered(struct emulated_magnetometer *chip)
{
    int sensor = 0, number = (int)(chip->conversions % NUMBERS);
    while (&others[0][sensor].common != chip)
        sensor++;
    middle_ns[sensor][number] = chip->now_ns - (uint64_t)(1e6 / (1 + chip->ppm * 1e-6));
    chip->field_gauss[0] = (STEP * number - NUMBERS) / 1024.0;
    chip->field_gauss[1] = -chip->field_gauss[0];
    return own_convert(chip);
}

static void begin_numbered(const struct promised *kind, int chips, uint16_t trigger, uint16_t frames_hz)
{
    chip_rig_begin(kind, 1);
    own_convert = others[0][0].common.convert;
    for (int i = 0; i < PAD_SENSORS_FOUND; i++) {
        others[0][i].common.convert = convert_numbered;
        bench_plug_part(&others[0][i].common.part, i < chips);
    }
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, trigger), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, frames_hz), RESULT_DONE);
    rig_run_ms(300);
    rig_forget();
}

// What frames say about measurements, beside the truth.
struct tally {
    int frames, whole, last[PAD_SENSORS_FOUND], fresh, old, skipped, odd;
    double worst_us;
};

static void tally_sensor(struct tally *tally, const struct promised *kind, const struct sample_view *view, int i)
{
    double scale = kind->counts_per_gauss[0][0] / 1024;
    int shown = (int)lround((NUMBERS - view->counts[i][1] / scale) / STEP);
    tally->odd += abs(view->counts[i][0] + view->counts[i][1]) > 1;
    CHECK_BETWEEN(shown, 0, NUMBERS - 1);
    int newer = (shown - tally->last[i] + NUMBERS) % NUMBERS;
    double error_us = fabs((double)(view->time_us - view->age_us[i]) - (double)middle_ns[i][shown] / 1e3);
    tally->worst_us = fmax(tally->worst_us, error_us);
    tally->fresh++;
    if (tally->last[i] >= 0) {
        tally->old += newer == 0 || newer > NUMBERS / 2;
        tally->skipped += newer > 0 ? newer - 1 : 0;
    }
    tally->last[i] = shown;
}

static struct tally tally_frames(const struct promised *kind, int chips, int frames)
{
    struct tally tally = {.last = {-1, -1, -1, -1}};
    while (tally.frames < frames) {
        rig_run_ms(1000);
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; tally.frames++) {
            struct sample_view view = rig_sample(packet);
            tally.whole += view.fresh == (1 << chips) - 1;
            for (int i = 0; i < chips; i++)
                if (view.fresh >> i & 1)
                    tally_sensor(&tally, kind, &view, i);
        }
        rig_forget();
    }
    return tally;
}

static void tells_new_samples_and_their_times_truly(const struct promised *kind)
{
    const char *wanted = getenv("FMFTS_FRAMES");
    int frames = wanted ? atoi(wanted) : 2000;
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        begin_numbered(kind, PAD_SENSORS_FOUND, trigger, trigger ? 203 : 220);
        struct tally tally = tally_frames(kind, PAD_SENSORS_FOUND, frames);
        if (wanted)
            printf("     %s: %d frames, %d of them whole, %d old samples called new, %d odd ones, worst time %.0f us off\n",
                   trigger ? "simultaneous" : "free", tally.frames, tally.whole, tally.old, tally.odd, tally.worst_us);
        CHECK_EQUAL(tally.old, 0);
        CHECK_EQUAL(tally.odd, 0);
        CHECK_BETWEEN(tally.worst_us, 0, US_WORST);
        CHECK_BETWEEN(tally.whole, 0.99 * tally.frames, tally.frames);
        if (trigger)
            CHECK_EQUAL(tally.skipped, 0);
    }
    CHECK_EQUAL(pad()->config_repairs, 0);
}
TEST_EACH_MEMSIC(tells_new_samples_and_their_times_truly)

static void reads_each_measurement_once_however_many_share_the_bus(const struct promised *kind)
{
    for (int chips = 1; chips <= PAD_SENSORS_FOUND; chips++) {
        int last[PAD_SENSORS_FOUND] = {-1, -1, -1, -1}, samples = 0;
        begin_numbered(kind, chips, 0, 220);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 3, 255, 1), RESULT_DONE); // all that are read, even between frames
        rig_run_ms(100);
        rig_forget();
        rig_run_ms(1000);
        for (const uint8_t *packet; (packet = rig_find(WIRE_EARLY)) != NULL; samples++) {
            int i = packet[1] >> 4 & 7;
            int16_t y = (int16_t)(packet[11] | packet[12] << 8);
            int number = (int)lround((NUMBERS - y / (kind->counts_per_gauss[0][0] / 1024)) / STEP);
            if (last[i] >= 0)
                CHECK_EQUAL(number, (last[i] + 1) % NUMBERS);
            last[i] = number;
        }
        CHECK_BETWEEN(samples, 350 * chips, 450 * chips);
    }
}
TEST_EACH_MEMSIC(reads_each_measurement_once_however_many_share_the_bus)

// Its clock is 12 % slow, so that the first poll after 2.2 ms comes too early.
static void waits_for_a_measurement_that_is_late(const struct promised *kind)
{
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        begin_numbered(kind, PAD_SENSORS_FOUND, trigger, 150);
        others[0][1].common.ppm = -120000;
        rig_run_ms(100);
        rig_forget();
        struct tally tally = tally_frames(kind, PAD_SENSORS_FOUND, 300);
        CHECK_EQUAL(tally.old, 0);
        CHECK_BETWEEN(tally.worst_us, 0, US_WORST); // half of 12 % of 2 ms, and the bus
        CHECK_EQUAL(pad()->config_repairs, 0);
    }
}
TEST_EACH_MEMSIC(waits_for_a_measurement_that_is_late)

// S p. 15: after a reset its bandwidth is 00, 8 ms. Nothing else shows it: the controls cannot be read.
static void notices_a_reset_by_the_time_that_a_measurement_takes(const struct promised *kind)
{
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        chip_rig_begin_streaming(kind, 0, 100);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, trigger), RESULT_DONE);
        rig_run_ms(200);
        for (int trial = 0; trial < 10; trial++) {
            uint32_t before = pad()->config_repairs;
            film(1)->common.part.kind->power_on(&film(1)->common.part);
            film(1)->polarity = -1; // a sample with the polarity of a pulse before the reset would show the other sign
            rig_forget();
            rig_run_ms(20);
            CHECK_EQUAL(pad()->config_repairs, before + 1);
            rig_run_ms(61.3);
            int whole = 0;
            for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
                struct sample_view view = rig_sample(packet);
                for (int i = 0; i < 4; i++)
                    if (view.valid >> i & 1 && view.counts[i][0] != INT16_MIN)
                        chip_rig_check_counts(kind, &view, i);
                whole = view.valid == 15 ? whole + 1 : 0;
            }
            CHECK(whole > 1);
        }
    }
}
TEST_EACH_MEMSIC(notices_a_reset_by_the_time_that_a_measurement_takes)

static bool is_marked(const struct sample_view *view, int sensor)
{
    const int16_t *counts = view->counts[sensor];
    return counts[0] == INT16_MIN && counts[1] == INT16_MIN && counts[2] == INT16_MIN;
}

// Frames of sensor 0 until `ms` later: those that are not marked show `field`, or the field before it.
static int count_unmarked(const struct promised *kind, double ms, const double field[3])
{
    int unmarked = 0;
    rig_forget();
    rig_run_ms(ms);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        if (!(view.fresh & 1) || is_marked(&view, 0))
            continue;
        for (int axis = 0; axis < 3; axis++) {
            double due = field[axis] * kind->counts_per_gauss[0][axis];
            CHECK_BETWEEN(view.counts[0][axis], due - 2 - 0.002 * fabs(due), due + 2 + 0.002 * fabs(due));
        }
        unmarked++;
    }
    return unmarked;
}

static void publishes_nothing_between_a_strong_field_and_the_next_set(const struct promised *kind)
{
    static const double rest[3] = {0.75, -1.5, 0.3};
    double times[] = {1.1, -1.1, 1.4, 2, 4};
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        chip_rig_begin_streaming(kind, 0, 150);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, trigger), RESULT_DONE);
        rig_run_ms(200);
        for (size_t t = 0; t < sizeof times / sizeof *times; t++) {
            for (int axis = 0; axis < 3; axis++) {
                double strong[3] = {rest[0], rest[1], rest[2]};
                strong[axis] = times[t] * film(0)->kind->upsetting_gauss;
                chip_rig_set_field(0, strong[0], strong[1], strong[2]);
                CHECK_BETWEEN(count_unmarked(kind, 100.3, rest), 0, 2); // the previous measurement
                chip_rig_set_field(0, rest[0], rest[1], rest[2]);
                CHECK(count_unmarked(kind, 60.7, rest) >= 5);
                CHECK(!film(0)->upset);
            }
        }
        CHECK_EQUAL(pad()->config_repairs, 0);
    }
}
TEST_EACH_MEMSIC(publishes_nothing_between_a_strong_field_and_the_next_set)

// Up to 9 G (S p. 2: 10) a field needs no SET; above that it does, even if no axis is at its end.
static void sets_its_film_anew_only_after_a_strong_field(const struct promised *kind)
{
    static const double rest[3] = {0.75, -1.5, 0.3};
    double each = kind->film_gauss / sqrt(3);
    chip_rig_begin_streaming(kind, 0, 100);
    rig_run_ms(200);
    uint64_t pulsed_ns = film(0)->pulsed_ns;
    chip_rig_set_field(0, 0.95 * each, 0.95 * each, -0.95 * each);
    rig_run_ms(50);
    struct sample_view view = chip_rig_newest();
    chip_rig_check_counts(kind, &view, 0);
    CHECK_EQUAL(film(0)->pulsed_ns, pulsed_ns);
    chip_rig_set_field(0, 1.03 * each, 1.03 * each, -1.03 * each);
    rig_run_ms(50);
    view = chip_rig_newest();
    CHECK(is_marked(&view, 0));
    CHECK_EQUAL(film(0)->pulsed_ns, pulsed_ns); // it would not last
    chip_rig_set_field(0, rest[0], rest[1], rest[2]);
    rig_run_ms(20);
    CHECK(film(0)->pulsed_ns > pulsed_ns);
    CHECK(count_unmarked(kind, 100, rest) > 5);
}
TEST_EACH_MEMSIC(sets_its_film_anew_only_after_a_strong_field)

// No source states how a field beyond 10 G reads. It may read like one that needs no SET.
static void sets_its_film_anew_when_a_doubtful_field_has_gone(const struct promised *kind)
{
    static const double rest[3] = {0.75, -1.5, 0.3};
    chip_rig_begin_streaming(kind, 0, 100);
    rig_run_ms(200);
    uint64_t pulsed_ns = film(0)->pulsed_ns;
    chip_rig_set_field(0, 0.65 * kind->film_gauss, 0.0, 0.0);
    rig_run_ms(50);
    struct sample_view view = chip_rig_newest();
    CHECK(!is_marked(&view, 0)); // it may well be true
    CHECK_EQUAL(film(0)->pulsed_ns, pulsed_ns);
    chip_rig_set_field(0, rest[0], rest[1], rest[2]);
    rig_run_ms(20);
    CHECK(film(0)->pulsed_ns > pulsed_ns);
    CHECK(count_unmarked(kind, 100, rest) > 5);
}
TEST_EACH_MEMSIC(sets_its_film_anew_when_a_doubtful_field_has_gone)

static void sets_its_film_anew_every_ten_minutes(const struct promised *kind)
{
    enum { SECOND = 1000000 };
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        chip_rig_begin_streaming(kind, 0, 150);
        CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, trigger), RESULT_DONE);
        rig_run_ms(200);
        uint64_t pulsed_ns = film(2)->pulsed_ns;
        pad()->sensors[2].set_us -= 598U * SECOND; // that long ago
        rig_run_ms(1000);
        CHECK_EQUAL(film(2)->pulsed_ns, pulsed_ns);
        rig_forget();
        rig_run_ms(2000);
        CHECK(film(2)->pulsed_ns > pulsed_ns);
        pulsed_ns = film(2)->pulsed_ns;
        int missed = 0;
        for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
            struct sample_view view = rig_sample(packet);
            missed += !(view.fresh >> 2 & 1);
            if (view.valid >> 2 & 1)
                chip_rig_check_counts(kind, &view, 2);
        }
        CHECK_BETWEEN(missed, 0, 1);
        rig_run_ms(5000);
        CHECK_EQUAL(film(2)->pulsed_ns, pulsed_ns);
    }
}
TEST_EACH_MEMSIC(sets_its_film_anew_every_ten_minutes)
