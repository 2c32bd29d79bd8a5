"""Judges a self-test: is each axis of a chip within its limits, and, with a bias strap, what is its real gain?"""

from __future__ import annotations

from collections.abc import Sequence

from fmfts.sensor.chips.chip import Axes, BiasStrap, Chip, OwnField

SATURATED = "saturated: the field outside leaves no room for the bias; move the magnet away and repeat"


def strap_counts(chip: Chip, unbiased: Axes, positive: Axes, negative: Axes) -> tuple[Axes, Axes]:
    """What the bias strap alone did, from the counts without and with either bias; saturated where one of them was.

    The data sheet says that the chip subtracts the external field itself; then positive and negative are symmetric
    about zero. A chip that does not shows them symmetric about the unbiased reading. Whichever is nearer is taken off,
    axis by axis, as in firmware/core/hmc5983.c: a strap that does nothing fails on both kinds.
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
    """The sentence for who asks for the self-test of a chip that has none."""
    return f"{chip.named} has no self-test that could measure its gains: `fmfts-daemon baseline --turn` measures them"


def own_field_counts(chip: Chip, without: Sequence[Axes], with_field: Sequence[Axes]) -> Axes:
    """What the chip's own field did, from samples without and with it; saturated where one of them was."""
    x, y, z = (
        chip.saturated_count
        if chip.saturated_count in (*before, *after)
        else round(sum(after) / len(after) - sum(before) / len(before))
        for before, after in zip(zip(*without, strict=True), zip(*with_field, strict=True), strict=True)
    )
    return x, y, z


def limits(chip: Chip, gain_code: int, axis: int) -> tuple[int, int]:
    """Least and largest count of a good axis: the data sheet's, scaled from the gain code that it gives them for."""
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
    """What a bias-strap measurement tells: per sensor and axis counts, gain relative to nominal, and what failed.

    positive, negative: counts per sensor under either bias, the external field subtracted; with an own field it is the
    first of them, and no gain is known.
    faults: per sensor, why there is no measurement at all.
    `gain_factor` multiplies the nominal counts per gauss of an axis; None where its counts are out of limits. Its
    deviation `gain_factor_sd` is that of the straps' fields.
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
                "positive_counts": list(up),
                "negative_counts": list(down),
                "gain_factor": [
                    None
                    if fault or chip.bias_strap is None
                    else _gain_factor(chip, gain_code, axis, up[axis], down[axis])
                    for axis in range(3)
                ],
            }
        )
    return {
        "gain_code": gain_code,
        "passed": all(one["passed"] for one in sensors),
        "sensors": sensors,
        "gain_factor_sd": None if chip.bias_strap is None else chip.bias_strap.deviation,
    }


def selftest_failures(chip: Chip, gain_code: int, up: Axes, down: Axes) -> list[str]:
    """What is wrong with one sensor's counts under the positive and the negative bias; empty if nothing is."""
    if chip.own_field is not None:
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
