#include "conversion.h"

enum {
    PERIOD_TOLERANCE = 20, // 1/20: ±5 %, more than the ±3 % of the chips
    // Both values minimise the error of time on the emulated chips, with four and with eight sensors on a bus. Polling
    // starts 1/POLL_EARLY of a period before the predicted end: later starts lose track of chips, earlier ones load the
    // bus.
    PERIOD_GAIN = 16,
    POLL_EARLY = 12,
    // The last end is an estimate and may be late, by up to 1/END_TOLERANCE of a period.
    END_TOLERANCE = 8,
};

void conversion_restart(struct conversion *conversion, uint16_t nominal_us, uint64_t now_us)
{
    if (conversion->nominal_us != nominal_us)
        conversion->nominal_us = conversion->period_us = nominal_us;
    conversion->ended_us = conversion->not_ready_us = conversion->ready_us = now_us;
}

static uint64_t clamp(uint64_t value, uint64_t low, uint64_t high)
{
    return value < low ? low : value > high ? high : value;
}

// The conversion ended after the last poll that found READY clear (or the last one that found it set), and before this
// poll. The chip's period says where in between. If the prediction lies outside these bounds, the period is corrected.
void conversion_seen(struct conversion *conversion, uint64_t seen_us)
{
    uint64_t period_us = conversion->period_us;
    uint64_t not_ready_us = conversion->not_ready_us, ready_us = conversion->ready_us;
    uint64_t earliest_us = not_ready_us > ready_us ? not_ready_us : ready_us;
    // The newest conversion is no older than the longest period.
    uint64_t longest_us = conversion->nominal_us + conversion->nominal_us / PERIOD_TOLERANCE;
    if (seen_us > earliest_us + longest_us)
        earliest_us = seen_us - longest_us;
    // 32 bits suffice, because the chip is polled at least every 71 minutes; the STM32 has no 64-bit division.
    uint32_t periods = (uint32_t)(seen_us - conversion->ended_us + period_us / END_TOLERANCE) / conversion->period_us;
    uint64_t predicted_us = conversion->ended_us + (periods ? periods : 1) * period_us;
    conversion->ended_us = clamp(predicted_us, earliest_us, seen_us);
    conversion->ready_us = seen_us;
    if (periods == 1) {
        uint64_t tolerance_us = conversion->nominal_us / PERIOD_TOLERANCE;
        int32_t correction_us = (int32_t)(conversion->ended_us - predicted_us) / PERIOD_GAIN;
        conversion->period_us = (uint16_t)clamp(period_us + (uint64_t)correction_us,
                                                conversion->nominal_us - tolerance_us,
                                                conversion->nominal_us + tolerance_us);
    }
}

uint64_t conversion_next_poll_us(const struct conversion *conversion)
{
    return conversion->ended_us + conversion->period_us - conversion->period_us / POLL_EARLY;
}
