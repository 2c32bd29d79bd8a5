// The MMC5983MA in a stream while its measurements end at any moment, also between two transfers of one reading.
#include <math.h>

#include "chip_rig.h"
#include "harness.h"

// Each measurement has its number on all three axes, so that a sample tells which one it is, and whether it is one.
enum { NUMBERS = 4000, STEP = 2 };

static uint64_t (*own_convert)(struct emulated_magnetometer *chip);
static uint64_t ended_ns[PAD_SENSORS_FOUND][NUMBERS];

static uint64_t convert_numbered(struct emulated_magnetometer *chip)
{
    int sensor = 0, number = (int)chip->conversions;
    while (&others[0][sensor].common != chip)
        sensor++;
    CHECK(number < NUMBERS);
    ended_ns[sensor][number] = chip->now_ns;
    chip->field_gauss[0] = (STEP * number - NUMBERS) / 4096.0;
    chip->field_gauss[1] = (NUMBERS - STEP * number) / 4096.0;
    chip->field_gauss[2] = chip->field_gauss[0] / 2;
    return own_convert(chip);
}

static int number_of(const int16_t counts[3])
{
    CHECK_EQUAL(counts[1], -counts[0]);
    CHECK_EQUAL(counts[2], -counts[0] / 2); // left-handed
    return (counts[0] + NUMBERS) / STEP;
}

static void begin_numbered(int frames_hz, bool holds_outputs)
{
    chip_rig_begin(&mmc5983ma, 1);
    own_convert = others[0][0].common.convert;
    for (int i = 0; i < PAD_SENSORS_FOUND; i++) {
        others[0][i].common.convert = convert_numbered;
        others[0][i].mmc5983ma.holds_outputs = holds_outputs;
    }
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 1, 255, 0), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, (uint16_t)frames_hz), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_START, 3, 255, 1), RESULT_DONE); // all that are read, also between frames
    rig_run_ms(300);
    rig_forget();
}

// How far the sample's time is from the end of its measurement, in µs.
static double check_sample(const uint8_t *packet, int last[PAD_SENSORS_FOUND], int *lost)
{
    int sensor = packet[1] >> 4 & 7;
    uint64_t time_us = 0;
    int16_t counts[3];
    for (int byte = 0; byte < 6; byte++)
        time_us |= (uint64_t)packet[3 + byte] << (8 * byte);
    for (int axis = 0; axis < 3; axis++)
        counts[axis] = (int16_t)(packet[9 + 2 * axis] | packet[10 + 2 * axis] << 8);
    int number = number_of(counts);
    CHECK_BETWEEN(number, last[sensor] + 1, NUMBERS);
    if (last[sensor])
        *lost += number - last[sensor] - 1;
    last[sensor] = number;
    return fabs((double)time_us - (double)ended_ns[sensor][number] / 1e3);
}

static void check_stream(int chips, int frames_hz, double period_us, bool holds_outputs)
{
    int last[PAD_SENSORS_FOUND] = {0}, samples = 0, lost = 0, frames = 0, fresh = 0;
    double sum_us = 0;
    begin_numbered(frames_hz, holds_outputs);
    for (int i = chips; i < PAD_SENSORS_FOUND; i++)
        bench_plug_part(&others[0][i].common.part, false);
    rig_run_ms(300);
    rig_forget();
    rig_run_ms(1500);
    for (const uint8_t *packet; (packet = rig_find(WIRE_EARLY)) != NULL; samples++) {
        double error_us = check_sample(packet, last, &lost);
        CHECK_BETWEEN(error_us, 0, period_us);
        sum_us += error_us;
    }
    // At 200 Hz none is lost. At 1000 Hz the next measurement may end beside a reading, and is then read instead. Several
    // chips at 1000 Hz are more than is read in time.
    if (frames_hz < 200)
        CHECK_EQUAL(lost, 0);
    else if (chips == 1)
        CHECK_BETWEEN(lost, 0, samples / 50);
    // The bus polls a chip every 0.2 ms, but each of several at 1000 Hz only every 0.5 to 2 ms.
    CHECK_BETWEEN(sum_us / samples, 0, chips == 1 || frames_hz < 200 ? 100 : period_us / 2);
    rig.read = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; frames++)
        for (int i = 0; i < chips; i++)
            fresh += rig_sample(packet).fresh >> i & 1;
    CHECK_BETWEEN(frames, 1.5 * frames_hz - 1, 1.5 * frames_hz + 1);
    CHECK_BETWEEN(fresh, 0.995 * chips * frames, chips * frames);
}

// With 1000 measurements a second one often ends while the one before is read; and the fewer chips share the bus, the
// sooner each is read again.
TEST(mmc5983ma_gives_no_measurement_twice_and_mixes_no_two)
{
    for (int holds_outputs = 0; holds_outputs < 2; holds_outputs++) {
        for (int chips = 1; chips <= PAD_SENSORS_FOUND; chips++) {
            check_stream(chips, 220, 1000 / 0.97, holds_outputs);
            check_stream(chips, 150, 500, holds_outputs);
        }
    }
}
