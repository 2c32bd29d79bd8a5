// The load cell's converter, in the stream of the frames.
#include "harness.h"
#include "rig.h"

static int32_t counts_of(const uint8_t *packet)
{
    uint32_t bits = 0;
    for (int i = 3; i >= 0; i--)
        bits = bits << 8 | packet[11 + i];
    return (int32_t)bits;
}

TEST(load_cell_streams_80_a_second_and_takes_no_frame_away)
{
    rig_begin(3);
    rig.emulation.converter.present = true;
    rig.emulation.converter.counts = 84213;
    rig_run_ms(500);
    rig_forget();
    rig_run_ms(10000);
    CHECK_BETWEEN(rig_count(WIRE_LOAD), 799, 801);
    CHECK_BETWEEN(rig_count(WIRE_SAMPLE), 3 * 2199, 3 * 2201);
    CHECK_EQUAL(counts_of(rig_next(WIRE_LOAD)), 84213);
    uint32_t valid = 0, samples = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL; samples++)
        valid += rig_sample(packet).valid == 15;
    CHECK_EQUAL(valid, samples);
}

TEST(both_ends_of_the_load_cells_range_keep_their_sign)
{
    static const int32_t ends[] = {-8388608, -1, 0, 8388607};
    for (int i = 0; i < 4; i++) {
        rig_begin_streaming(1);
        rig.emulation.converter.present = true;
        rig.emulation.converter.counts = ends[i];
        rig_run_ms(100);
        CHECK_EQUAL(counts_of(rig_next(WIRE_LOAD)), ends[i]);
    }
}

TEST(without_a_load_cell_nothing_is_said_of_one)
{
    rig_begin_streaming(1);
    rig_run_ms(1000);
    CHECK_EQUAL(rig_count(WIRE_LOAD), 0);
}

static bool shorted(void *context)
{
    (void)context;
    return false;
}

static void unheard(void *context, bool high)
{
    (void)context, (void)high;
}

TEST(shorted_data_pin_is_no_load_cell)
{
    const struct load_cell_pins pins = {shorted, unheard, NULL};
    int32_t counts;
    CHECK(!load_cell_read(&pins, &counts));
}
