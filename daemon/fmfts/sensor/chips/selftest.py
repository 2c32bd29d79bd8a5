"""Judges a self-test: is each axis of a chip within its limits, and what is its real gain, or its own zero?"""

from __future__ import annotations

from collections.abc import Sequence

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Axes, BiasStrap, Chip, OwnField, SetReset

SATURATED = "saturated: the field outside leaves no room for the bias; move the magnet away and repeat"


def strap_counts(chip: Chip, unbiased: Axes, positive: Axes, negative: Axes) -> tuple[Axes, Axes]:
    """The effect of the bias strap alone, from the counts without and with either bias; saturated where one of them
    was.

    The data sheet says that the chip subtracts the external field itself; then positive and negative are symmetric
    about zero. A chip that does not subtract it shows them symmetric about the unbiased reading. The nearer centre is
    subtracted, axis by axis, as in firmware/core/hmc5983.c: a dead strap fails on both kinds.
    """
    axes = [_strap_axis(chip, *counts) for counts in zip(unbiased, positive, negative, strict=True)]
    (x, y, z), (x_down, y_down, z_down) = zip(*axes, strict=True)
    return (x, y, z), (x_down, y_down, z_down)


def _strap_axis(chip: Chip, unbiased: int, plus: int, minus: int) -> tuple[int, int]:
    if chip.saturated_count in (unbiased, plus, minus):
        return chip.saturated_count, chip.saturated_count
    twice_the_centre = plus + minus
    external = unbiased if abs(twice_the_centre - 2 * unbiased) < abs(twice_the_centre) else 0
    return plus - external, minus - external


def strap_of(chip: Chip) -> BiasStrap:
    """ValueError where the chip has none."""
    if chip.bias_strap is None:
        raise ValueError(no_selftest(chip))
    return chip.bias_strap


def no_selftest(chip: Chip) -> str:
    """The sentence for a chip that has no self-test, or none here."""
    if chip.tested_on_i2c:
        return (
            f"{chip.named} is tested only on an I2C bus of the computer, neither by a board nor in the simulation: "
            "`fmfts-daemon baseline --bare` measures its zeros, `--turn` its gains"
        )
    return f"{chip.named} has no self-test that could measure its gains: `fmfts-daemon baseline --turn` measures them"


def own_field_counts(chip: Chip, without: Sequence[Axes], with_field: Sequence[Axes]) -> Axes:
    """The effect of the chip's own field, from samples without and with it; saturated axes are marked."""
    return _of_both(chip, without, with_field, (-1.0, 1.0))


def bridge_zero_counts(chip: Chip, after_set: Sequence[Axes], after_reset: Sequence[Axes]) -> Axes:
    """The bridges' readings without a field, from samples after either pulse; saturated axes are marked."""
    return _of_both(chip, after_set, after_reset, (0.5, 0.5))


def _of_both(chip: Chip, first: Sequence[Axes], second: Sequence[Axes], weights: tuple[float, float]) -> Axes:
    """The weighted sum of both means, axis by axis."""
    x, y, z = (
        chip.saturated_count
        if chip.saturated_count in (*ones, *others)
        else round(weights[0] * sum(ones) / len(ones) + weights[1] * sum(others) / len(others))
        for ones, others in zip(zip(*first, strict=True), zip(*second, strict=True), strict=True)
    )
    return x, y, z


def limits(chip: Chip, gain_code: int, axis: int) -> tuple[int, int]:
    """Smallest and largest count of a good axis: the data sheet's, scaled from its gain code."""
    strap = strap_of(chip)
    scale = chip.counts_per_gauss[gain_code][axis] / chip.counts_per_gauss[strap.gain_code][axis]
    low, high = strap.limits
    return round(low * scale), round(high * scale)


def selftest_facts(
    chip: Chip,
    gain_code: int,
    positive: Sequence[Axes],
    negative: Sequence[Axes],
    faults: Sequence[str | None] = (),
) -> dict[str, object]:
    """The facts of a self-test: per sensor and axis the counts, the gain relative to nominal, and failures.

    positive, negative: counts per sensor under either bias, the external field subtracted; with an own field it is the
    first of them, and no gain is known. With set and reset pulses: the bridges' zeros, and the effect of reversing the
    coil's current; as `zero_t` and `coil_t` in the frames' axes, None if an axis is saturated. faults: per sensor, why
    there is no measurement at all. `gain_factor` multiplies the nominal counts per gauss of an axis; None where its
    counts are out of limits. Its deviation `gain_factor_sd` is that of the straps' fields.
    """
    sensors = []
    for index, (up, down) in enumerate(zip(positive, negative, strict=True)):
        fault = faults[index] if faults else None
        failures = [fault] if fault else selftest_failures(chip, gain_code, up, down)
        sensors.append(
            {
                "sensor": index + 1,
                "passed": not failures,
                "failures": failures,
                **_measured(chip, gain_code, up, down, fault),
                "gain_factor": [
                    None
                    if fault or chip.bias_strap is None
                    else _gain_factor(chip, gain_code, axis, up[axis], down[axis])
                    for axis in range(3)
                ],
            }
        )
    good_up_to = (
        {} if chip.set_reset is None else {"largest_zero_t": chip.set_reset.largest_zero_gauss * TESLA_PER_GAUSS}
    )
    return {
        "gain_code": gain_code,
        "passed": all(one["passed"] for one in sensors),
        **good_up_to,
        "sensors": sensors,
        "gain_factor_sd": None if chip.bias_strap is None else chip.bias_strap.deviation,
    }


def _measured(chip: Chip, gain_code: int, up: Axes, down: Axes, fault: str | None) -> dict[str, object]:
    if chip.set_reset is None:
        return {"positive_counts": list(up), "negative_counts": list(down)}
    fields_t = [
        [
            None if fault or counts == chip.saturated_count else counts * float(step_t)
            for counts, step_t in zip(axes, chip.step_t[gain_code], strict=True)
        ]
        for axes in (up, down)
    ]
    return {"zero_t": fields_t[0], "coil_t": fields_t[1]}


def selftest_failures(chip: Chip, gain_code: int, up: Axes, down: Axes) -> list[str]:
    """What is wrong with one sensor's counts, as `selftest_facts` has them; empty if nothing is."""
    if chip.set_reset is not None:
        test = chip.set_reset
        reasons = [_set_reset_failure(chip, test, gain_code, axis, up[axis], down[axis]) for axis in range(3)]
    elif chip.own_field is not None:
        reasons = [_own_field_failure(chip, chip.own_field, axis, up[axis]) for axis in range(3)]
    else:
        reasons = [_axis_failure(chip, gain_code, axis, up[axis], down[axis]) for axis in range(3)]
    return [f"{axis}: {reason}" for axis, reason in zip("xyz", reasons, strict=True) if reason]


def _gain_factor(chip: Chip, gain_code: int, axis: int, plus: int, minus: int) -> float | None:
    if _axis_failure(chip, gain_code, axis, plus, minus) is not None:
        return None
    nominal = strap_of(chip).field_gauss[axis] * chip.counts_per_gauss[gain_code][axis]
    return (plus - minus) / 2 / nominal


def _axis_failure(chip: Chip, gain_code: int, axis: int, plus: int, minus: int) -> str | None:
    low, high = limits(chip, gain_code, axis)
    if chip.saturated_count in (plus, minus):
        return SATURATED
    if not (low <= plus <= high and low <= -minus <= high):
        return f"{plus:+d} and {minus:+d} counts under the bias, where ±{low} to ±{high} are due: the chip is damaged"
    return None


def _own_field_failure(chip: Chip, test: OwnField, axis: int, counts: int) -> str | None:
    low, high = test.limits[axis]
    if counts == chip.saturated_count:
        return SATURATED
    if not low <= abs(counts) <= high:
        return f"{counts:+d} counts of the chip's own field, where {low} to {high} are due: the chip is damaged"
    return None


def _set_reset_failure(chip: Chip, test: SetReset, gain_code: int, axis: int, zero: int, coil: int) -> str | None:
    if chip.saturated_count in (zero, coil):
        return SATURATED
    step_t = float(chip.step_t[gain_code, axis])
    if abs(coil * step_t) < test.least_coil_gauss * TESLA_PER_GAUSS:
        return f"does not measure the chip's coil ({coil * step_t * 1e6:+.1f} µT): the axis is dead, replace the chip"
    largest_t = test.largest_zero_gauss * TESLA_PER_GAUSS
    if abs(zero * step_t) > largest_t:
        return (
            f"its zero is {zero * step_t * 1e6:+.1f} µT, where ±{largest_t * 1e6:.0f} are due: magnetised, or broken: "
            "take magnets away, switch it off and on, and repeat; if it stays, replace the chip"
        )
    return None
