// The MLX90393's driver alone: facts that a stream shows late or never.
#include "../../firmware/core/chips/chip.h"
#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/emulated_mlx90393.h"
#include "chip_bench.h"
#include "chip_rig.h"
#include "harness.h"

static struct emulated_mlx90393 chip;
static const struct chip_wires wires = {.bus = &bench.buses[0], .address = 0x0C};
static const struct chip_setup streaming = {.gain_code = 2, .speed = 3, .streams = true}, single = {.gain_code = 2};

static void begin_with_mlx90393(const struct chip_setup *setup)
{
    bench_init(&bench);
    emulated_mlx90393_init(&chip, 0x0C, 1);
    bench_add_switch(&bench, 0, SWITCH)->chips[0] = &chip.common.part;
    CHECK_EQUAL(tca9548a_select(bus, SWITCH, 1), BUS_OK);
    CHECK_EQUAL(chip_mlx90393.reset(&wires), BUS_OK);
    pass(2 * MS);
    CHECK_EQUAL(chip_mlx90393.set_up(&wires, setup), BUS_OK);
}

static bool is_set_up(const struct chip_setup *setup)
{
    bool held = false;
    CHECK_EQUAL(chip_mlx90393.check(&wires, setup, &held), BUS_OK);
    return held;
}

TEST(mlx90393_check_sees_that_it_streams_and_that_a_reset_ended_that)
{
    begin_with_mlx90393(&streaming);
    CHECK(is_set_up(&streaming));
    chip.common.part.kind->power_on(&chip.common.part);
    CHECK(!is_set_up(&streaming));
}

TEST(mlx90393_check_reads_registers_back_between_single_measurements)
{
    begin_with_mlx90393(&single);
    pass(4 * MS); // the measurement that it begins with ends
    CHECK(is_set_up(&single));
    for (int number = 0; number < 3; number++) {
        chip.words[number] ^= 0x10;
        CHECK(!is_set_up(&single));
        chip.words[number] ^= 0x10;
    }
    CHECK(is_set_up(&single));
}

TEST(mlx90393_check_does_not_take_a_running_measurement_for_a_fault)
{
    begin_with_mlx90393(&single);
    CHECK_EQUAL(chip_write(&wires, chip_mlx90393.trigger->bytes, chip_mlx90393.trigger->count), BUS_OK);
    CHECK(is_set_up(&single));
    pass(4 * MS);
    CHECK(is_set_up(&single));
}

// Melexis rev. 002, page 16: the status of the first measurement's command must be read. A trigger gets no answer.
TEST(mlx90393_first_triggered_measurement_after_power_on_is_right)
{
    struct chip_sample sample = {.status = 0};
    begin_with_mlx90393(&single);
    pass(4 * MS);
    chip.common.field_gauss[0] = 20;
    CHECK_EQUAL(chip_write(&wires, chip_mlx90393.trigger->bytes, chip_mlx90393.trigger->count), BUS_OK);
    pass(4 * MS);
    CHECK_EQUAL(chip_mlx90393.read_status(&wires, &sample), BUS_OK);
    CHECK_EQUAL(sample.status, CHIP_READY);
    CHECK_EQUAL(sample.counts[0], 20 * 100 / (4 * 0.250));
}

// Adafruit_MLX90393, issues 17 and 18: real parts take longer than the table; one that takes 1.3 times as long is in
// time.
TEST(mlx90393_of_a_slow_kind_is_triggered_at_its_rate)
{
    chip_rig_begin_streaming(&mlx90393, 0, 50);
    for (int i = 0; i < 4; i++) {
        others[0][i].mlx90393.slowness = 1.29;
        others[0][i].common.ppm = 0;
    }
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, 1), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 5, 255, (uint16_t)mlx90393.single_max_hz), RESULT_DONE);
    rig_run_ms(500);
    rig_forget();
    rig_run_ms(1000);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), mlx90393.single_max_hz - 2, mlx90393.single_max_hz + 1);
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        CHECK_EQUAL(rig_sample(packet).fresh, 15);
    CHECK_EQUAL(rig.emulation.device.sampler.pads[0].bus_errors, 0);
    for (int i = 0; i < 4; i++)
        CHECK(!rig.emulation.device.sampler.pads[0].sensors[i].suspect); // asked before it had finished
}

TEST(mlx90393_that_loses_what_is_written_does_not_count_as_set_up)
{
    for (int streams = 0; streams < 2; streams++) {
        begin_with_mlx90393(&single);
        pass(4 * MS);
        chip.common.writes_lost = true;
        const struct chip_setup *setup = streams ? &streaming : &single;
        chip.words[1] = 0;
        CHECK_EQUAL(chip_mlx90393.set_up(&wires, setup), BUS_OK);
        CHECK(!is_set_up(setup));
    }
}

TEST(mlx90393_is_told_by_its_status_and_its_hall_configuration)
{
    static const uint8_t right[3] = {0x04, 0x12, 0x7C}, other[3] = {0, 0, 0x7B}, refused[3] = {0x10, 0, 0x7C},
                         in_a_burst[3] = {0x80, 0, 0x7C}, nobody[3] = {0xFF, 0xFF, 0xFF};
    CHECK(chip_mlx90393.is_identification(right));
    CHECK(!chip_mlx90393.is_identification(other));
    CHECK(!chip_mlx90393.is_identification(refused));
    CHECK(!chip_mlx90393.is_identification(in_a_burst));
    CHECK(!chip_mlx90393.is_identification(nobody));
}

TEST(mlx90393_keeps_what_the_factory_wrote)
{
    begin_with_mlx90393(&streaming);
    CHECK_EQUAL(chip.words[0], 0x0600 | 5 << 4 | 0x0C);
}

TEST(mlx90393_hands_each_measurement_out_once)
{
    struct chip_sample sample = {.status = 0};
    begin_with_mlx90393(&streaming);
    pass(5 * MS);
    CHECK_EQUAL(chip_mlx90393.read_status(&wires, &sample), BUS_OK);
    CHECK_EQUAL(sample.status, CHIP_READY);
    CHECK_EQUAL(sample.temperature_raw, 46244 - 65536);
    CHECK_EQUAL(chip_mlx90393.read_status(&wires, &sample), BUS_OK);
    CHECK_EQUAL(sample.status, 0);
}
