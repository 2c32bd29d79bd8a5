// Pads without a mux: four chips with an address each on a bus that also has a pad with a mux.
#include <string.h>

#include "chip_rig.h"
#include "harness.h"

enum { DIRECT = 1, FIRST_ADDRESS = 0x0C };

// Pad 0: HMC5983 behind its mux. Pad 1: four MLX90393 on the same bus.
static void begin(void)
{
    rig_begin(2);
    struct emulation *emulation = &rig.emulation;
    bench_plug_switch(emulation->switches[DIRECT], false);
    emulation->pads.found[DIRECT] = (struct pad_wiring){0, TCA9548A_NONE, PAD_SENSORS_FOUND, FIRST_ADDRESS};
    for (int i = 0; i < PAD_SENSORS_FOUND; i++) {
        union any_chip *chip = &others[DIRECT][i];
        emulated_mlx90393_init(&chip->mlx90393, (uint8_t)(FIRST_ADDRESS + i), (uint32_t)(i + 1));
        memcpy(chip->common.field_gauss, chip_field_gauss[i], sizeof chip_field_gauss[i]);
        emulation->bench.lines[0].direct[i] = &chip->common.part;
    }
    emulation_reset(emulation);
    rig_forget();
}

static void stream(uint16_t rate_hz)
{
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 1, 255, 0), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, rate_hz), RESULT_DONE);
    rig_run_ms(400);
    rig_forget();
}

static void check_samples_of_both(void)
{
    int seen = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; seen++) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.sensor_count, 4);
        CHECK_EQUAL(view.valid, 15);
        for (int i = 0; i < 4 && view.pad_index == DIRECT; i++)
            chip_rig_check_counts_of(&mlx90393, &view, DIRECT, i);
    }
    CHECK_BETWEEN(seen, 20, 250);
    CHECK_EQUAL(rig.emulation.bench.contentions, 0);
}

TEST(pad_without_a_mux_tells_its_sensors_by_their_addresses)
{
    begin();
    rig_run_ms(250);
    const uint8_t *hello = rig_next(WIRE_HELLO) + 22;
    CHECK_EQUAL(hello[1], 0x70);
    hello += 3 + 5 * PAD_SENSORS_FOUND;
    CHECK_EQUAL(hello[1], 0);
    for (int i = 0; i < PAD_SENSORS_FOUND; i++) {
        CHECK_EQUAL(hello[3 + 5 * i], FIRST_ADDRESS + i);
        CHECK_EQUAL(hello[3 + 5 * i + 1], SENSOR_OK);
    }
}

TEST(pads_with_and_without_a_mux_stream_side_by_side)
{
    begin();
    rig_run_ms(250);
    stream(100);
    rig_run_ms(1100);
    CHECK_EQUAL(rig_status_u32(DIRECT, 0), 0);
    check_samples_of_both();
}

TEST(each_sensor_without_a_mux_is_triggered_by_itself)
{
    begin();
    rig_run_ms(250);
    stream(50);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_TRIGGER, 3, 255, TRIGGER_SIMULTANEOUS), RESULT_DONE);
    rig_run_ms(200);
    rig_forget();
    rig_run_ms(300);
    check_samples_of_both();
}

TEST(chip_at_another_sensors_address_is_not_taken_for_it)
{
    begin();
    others[DIRECT][2].common.part.address = 0x18;
    rig_run_ms(1500);
    CHECK_EQUAL(rig_state(DIRECT, 1), SENSOR_OK);
    CHECK_EQUAL(rig_state(DIRECT, 2), SENSOR_NO_ANSWER);
    CHECK_EQUAL(rig_state(DIRECT, 3), SENSOR_OK);
    CHECK_EQUAL(rig_state(0, 2), SENSOR_OK);
    others[DIRECT][2].common.part.address = FIRST_ADDRESS + 2;
    rig_run_ms(2000);
    CHECK_EQUAL(rig_state(DIRECT, 2), SENSOR_OK);
}
