#include "../../firmware/core/tca9548a.h"
#include "../../firmware/emulated/bench.h"
#include "harness.h"

static struct bench bench;
static struct emulated_switch *first, *second;
static struct route route;

static void begin(void)
{
    bench_init(&bench);
    first = bench_add_switch(&bench, 0, 0x70);
    second = bench_add_switch(&bench, 0, 0x71);
    first->channels = first->control = 0xFF; // left over from before the reset
    second->channels = second->control = 0xFF;
    route_init(&route, &bench.buses[0]);
    route_add_switch(&route, 0x70);
    route_add_switch(&route, 0x71);
}

TEST(route_closes_all_other_switches_before_it_opens_one)
{
    begin();
    CHECK_EQUAL(route_open(&route, 0x71, 4), BUS_OK);
    CHECK_EQUAL(first->channels, 0);
    CHECK_EQUAL(second->channels, 4);
    CHECK_EQUAL(route_open(&route, 0x70, 1), BUS_OK);
    CHECK_EQUAL(first->channels, 1);
    CHECK_EQUAL(second->channels, 0);
}

TEST(route_that_is_open_costs_no_transfer)
{
    begin();
    route_open(&route, 0x70, 1);
    unsigned transfers = bench.lines[0].transfers;
    CHECK_EQUAL(route_open(&route, 0x70, 1), BUS_OK);
    CHECK_EQUAL(bench.lines[0].transfers, transfers);
    route_open(&route, 0x70, 2);
    CHECK_EQUAL(bench.lines[0].transfers, transfers + 1);
}

TEST(absent_switch_does_not_block_its_neighbour)
{
    begin();
    bench_plug_switch(first, false);
    CHECK_EQUAL(route_open(&route, 0x70, 1), BUS_NO_ANSWER);
    CHECK_EQUAL(route_open(&route, 0x71, 1), BUS_OK);
    CHECK_EQUAL(second->channels, 1);
}

TEST(switch_that_cannot_be_closed_keeps_the_route_shut)
{
    begin();
    route_open(&route, 0x70, 1);
    bench.lines[0].fail_count = 1;
    bench.lines[0].fail_result = BUS_TIMEOUT;
    CHECK_EQUAL(route_open(&route, 0x71, 1), BUS_TIMEOUT);
    CHECK(!route.known);
    CHECK_EQUAL(route_open(&route, 0x71, 1), BUS_OK);
    CHECK_EQUAL(first->channels, 0);
}

TEST(one_missed_acknowledge_does_not_leave_two_switches_open)
{
    begin();
    route_open(&route, 0x70, 1);
    bench.lines[0].fail_count = 1;
    bench.lines[0].fail_result = BUS_NO_ANSWER;
    CHECK_EQUAL(route_open(&route, 0x71, 1), BUS_OK);
    CHECK_EQUAL(first->channels, 0);
}

TEST(switch_that_lost_its_channel_is_noticed_and_selected_anew)
{
    bool held = false;
    begin();
    route_open(&route, 0x70, 8);
    CHECK_EQUAL(route_check(&route, &held), BUS_OK);
    CHECK(held);
    first->control = first->channels = 0;
    CHECK_EQUAL(route_check(&route, &held), BUS_OK);
    CHECK(!held);
    route_open(&route, 0x70, 8);
    CHECK_EQUAL(first->channels, 8);
}
