// The estimate of conversion times, against a chip whose conversions are known, on a bus that is sometimes busy.
#include <stdlib.h>

#include "../../firmware/core/conversion.h"
#include "../../firmware/core/hmc5983.h"
#include "harness.h"

enum { CONVERSIONS = 5000, POLL_US = 150 };

static uint32_t random_state;

static uint64_t delay_us(uint32_t limit)
{
    random_state = random_state * 1664525U + 1013904223U;
    return (random_state >> 8) % limit;
}

// Follows a chip of this period; polls come up to `busy_us` late. Returns the mean error of the second half in µs.
static double follow(struct conversion *conversion, uint64_t period_us, uint32_t busy_us)
{
    uint64_t now_us = 1000000, ended_us = now_us + 1000, sum_us = 0, last_us = 0;
    *conversion = (struct conversion){0};
    random_state = 1;
    conversion_restart(conversion, HMC5983_PERIOD_US, now_us);
    for (int i = 0; i < CONVERSIONS; i++) {
        uint64_t poll_us = conversion_next_poll_us(conversion);
        now_us = (poll_us > now_us ? poll_us : now_us) + delay_us(busy_us);
        for (; now_us < ended_us; now_us += POLL_US)
            conversion->not_ready_us = now_us;
        while (ended_us + period_us <= now_us)
            ended_us += period_us;
        conversion_seen(conversion, now_us);
        CHECK(conversion->ended_us <= now_us && conversion->ended_us > last_us);
        last_us = conversion->ended_us;
        if (i > CONVERSIONS / 2)
            sum_us += (uint64_t)llabs((long long)(conversion->ended_us - ended_us));
        ended_us += period_us;
    }
    return (double)sum_us / (CONVERSIONS / 2.0);
}

TEST(period_of_any_chip_within_tolerance_is_learned)
{
    for (uint64_t period_us = 4409; period_us <= 4681; period_us += 16) { // ±3 %
        struct conversion conversion;
        double error_us = follow(&conversion, period_us, 400);
        CHECK_BETWEEN(conversion.period_us, (double)period_us - 16, (double)period_us + 16); // 1/PERIOD_GAIN µs is lost
        CHECK_BETWEEN(error_us, 0, POLL_US / 3.0);
    }
}

TEST(late_polls_do_not_pass_for_a_slow_clock)
{
    struct conversion conversion;
    for (uint64_t period_us = 4409; period_us <= 4681; period_us += 68) {
        follow(&conversion, period_us, 1500);
        CHECK_BETWEEN(conversion.period_us, (double)period_us - 60, (double)period_us + 60);
    }
}

TEST(period_stays_within_tolerance_for_a_chip_that_is_off)
{
    struct conversion conversion;
    follow(&conversion, 6000, 300);
    CHECK_EQUAL(conversion.period_us, 4772);
    follow(&conversion, 3500, 300);
    CHECK_BETWEEN(conversion.period_us, 4318, 4772);
}
