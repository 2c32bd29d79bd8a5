// How a board with a broken bus or switch appears to a host.
#include "harness.h"
#include "rig.h"

TEST(lost_switch_takes_its_own_pad_only)
{
    rig_begin_streaming(2);
    bench_plug_switch(rig.emulation.switches[0], false);
    rig_run_ms(200);
    for (int i = 0; i < 4; i++) {
        CHECK_EQUAL(rig_state(0, i), SENSOR_MUX_NO_ANSWER);
        CHECK_EQUAL(rig_state(1, i), SENSOR_OK);
    }
    rig_forget();
    rig_run_ms(1000);
    int fresh = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        CHECK_EQUAL(view.valid, view.pad_index == 0 ? 0 : 15);
        fresh += view.fresh & 1;
    }
    CHECK(fresh > 200);
    bench_plug_switch(rig.emulation.switches[0], true);
    rig_run_ms(2500);
    for (int i = 0; i < 4; i++)
        CHECK_EQUAL(rig_state(0, i), SENSOR_OK);
}

TEST(lost_switch_is_noticed_with_simultaneous_triggers)
{
    rig_begin_streaming(2);
    rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, 1);
    rig_run_ms(100);
    bench_plug_switch(rig.emulation.switches[1], false);
    rig_run_ms(1200);
    CHECK_EQUAL(rig_state(1, 0), SENSOR_MUX_NO_ANSWER);
    CHECK_EQUAL(rig_state(0, 0), SENSOR_OK);
}

TEST(switch_that_browns_out_is_selected_again)
{
    rig_begin_streaming(1);
    for (int trial = 0; trial < 20; trial++) {
        struct emulated_switch *sw = rig.emulation.switches[0];
        sw->control = sw->channels = 0;
        rig_run_ms(37.3);
    }
    rig_forget();
    rig_run_ms(1100);
    for (int i = 0; i < 4; i++)
        CHECK_EQUAL(rig_state(0, i), SENSOR_OK);
}

TEST(switch_that_shows_another_sensor_is_set_right)
{
    rig_begin(1);
    rig.emulation.pads.wanted = 1; // the channel is never changed, so only the read-back can notice
    device_init(&rig.emulation.device, &rig.emulation.board);
    rig_run_ms(500);
    struct emulated_switch *sw = rig.emulation.switches[0];
    sw->control = sw->channels = 2;
    rig_run_ms(300);
    CHECK_EQUAL(sw->channels, 1);
    CHECK_EQUAL(rig.emulation.device.sampler.pads[0].bus_errors, 1);
}

TEST(stuck_bus_is_recovered_and_counted)
{
    rig_begin_streaming(1);
    rig.emulation.bench.lines[0].stuck = true;
    rig_run_ms(1200);
    CHECK_EQUAL(rig.emulation.bench.lines[0].recoveries, 1);
    CHECK_EQUAL(rig_status_u32(0, 1), 1);
    CHECK(rig_status_u32(0, 0) >= 1);
    CHECK_EQUAL(rig_state(0, 0), SENSOR_OK);
}

TEST(bus_that_stays_stuck_leaves_the_other_bus_alone_and_is_tried_again)
{
    rig_begin_streaming(3);
    rig.emulation.bench.lines[0].stuck_for_good = true;
    rig_run_ms(1000);
    rig_forget();
    rig_run_ms(1000);
    CHECK_EQUAL(rig_state(0, 0), SENSOR_BUS_STUCK);
    CHECK_EQUAL(rig_state(1, 3), SENSOR_BUS_STUCK);
    CHECK_EQUAL(rig_state(2, 0), SENSOR_OK);
    int fresh = 0;
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;) {
        struct sample_view view = rig_sample(packet);
        if (view.pad_index == 2)
            fresh += view.fresh & 1;
        else
            CHECK_EQUAL(view.valid, 0);
    }
    CHECK(fresh > 200);
    rig.emulation.bench.lines[0].stuck_for_good = false;
    rig_run_ms(2500);
    CHECK_EQUAL(rig_state(0, 0), SENSOR_OK);
    CHECK_EQUAL(rig_state(1, 3), SENSOR_OK);
}

TEST(single_bus_errors_of_any_kind_cost_no_sensor)
{
    static const enum bus_result errors[] = {BUS_NO_ANSWER, BUS_TIMEOUT, BUS_ARBITRATION};
    for (uint16_t trigger = 0; trigger < 2; trigger++) {
        rig_begin_streaming(1);
        rig_ask(WIRE_REQUEST_TRIGGER, 1, 255, trigger);
        for (int trial = 0; trial < 60; trial++) {
            rig.emulation.bench.lines[0].fail_count = 1;
            rig.emulation.bench.lines[0].fail_result = errors[trial % 3];
            rig_run_ms(23.7);
        }
        for (const uint8_t *status; (status = rig_find(WIRE_STATUS)) != NULL;)
            for (int i = 0; i < 4; i++)
                CHECK_EQUAL(status[29 + i], SENSOR_OK);
        rig_forget();
        rig_run_ms(1100);
        CHECK_EQUAL(rig_status_u32(0, 0), 60);
        CHECK_EQUAL(rig_status_u32(0, 1), 40);
        for (int i = 0; i < 4; i++)
            CHECK_EQUAL(rig_state(0, i), SENSOR_OK);
    }
}
