"""The HMC5983 three-axis magnetometer: registers and what their numbers mean (Honeywell data sheet 900425).

Its predecessor HMC5883L differs in what `chip` distinguishes here: at most 75 Hz, no compensation, no thermometer.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import Struct

ADDRESS = 0x1E
# Gain code (CRB bits 7–5) → counts per gauss and the largest field per axis, both from the gain table.
LSB_PER_GAUSS = (1370, 1090, 820, 660, 440, 390, 330, 230)
RANGE_GAUSS = (0.88, 1.3, 1.9, 2.5, 4.0, 4.7, 5.6, 8.1)
LARGEST_COUNT = 2047  # of the 12-bit converter; the gain table's range is the one it recommends, a fifth smaller
OVERFLOW_COUNT = -4096
OUTPUT_RATE_HZ = (0.75, 1.5, 3.0, 7.5, 15.0, 30.0, 75.0, 220.0)  # CRA bits 4–2; code 7 on the HMC5983 only
CHIP_RATE_HZ = {"hmc5983": 220, "hmc5883l": 75}
SINGLE_RATE_HZ = 160  # single measurements: 6 ms each
SINGLE_CONVERSION_S = 6e-3
SINGLE_WAIT_S = 6.2e-3  # the same by the slowest chip: clock tolerance 3 %

CONFIG_A, CONFIG_B, MODE, DATA, STATUS, IDENTIFICATION, TEMPERATURE = 0x00, 0x01, 0x02, 0x03, 0x09, 0x0A, 0x31
IDENTITY = b"H43"
STATUS_READY = 0x01
MODE_CONTINUOUS, MODE_SINGLE = 0x00, 0x01
TEMPERATURE_COMPENSATION = 0x80  # off at power-on
AVERAGE_8 = 0x60
BIAS_NONE, BIAS_POSITIVE, BIAS_NEGATIVE = 0x00, 0x01, 0x02

SELFTEST_GAIN_CODE = 5
SELFTEST_LIMITS = (243, 575)  # counts at gain code 5, of either sign
STRAP_GAUSS = (1.16, 1.16, 1.08)  # the bias strap's nominal field; its own tolerance is inside the limits

_AXES = Struct(">hhh")

Axes = tuple[int, int, int]


def gain_code_for_range(range_gauss: float) -> int:
    """The gain code whose range is `range_gauss`; ValueError names the ranges that exist."""
    for code, value in enumerate(RANGE_GAUSS):
        if abs(value - range_gauss) < 1e-9:
            return code
    raise ValueError(f"the chip has no range of ±{range_gauss} G: one of {', '.join(map(str, RANGE_GAUSS))}")


def highest_rate_hz(chip: str, trigger: str) -> int:
    """What the chip can deliver: by itself ("free"), or at the host's word ("simultaneous")."""
    return SINGLE_RATE_HZ if trigger == "simultaneous" else CHIP_RATE_HZ[chip]


def output_rate_hz(chip: str, rate_hz: float) -> float:
    """The chip's slowest own rate that is not below `rate_hz`; ValueError where there is none."""
    for rate in OUTPUT_RATE_HZ:
        if rate_hz <= rate <= CHIP_RATE_HZ[chip]:
            return rate
    raise ValueError(f"the {chip} delivers at most {CHIP_RATE_HZ[chip]} Hz, not {rate_hz:g} Hz")


def config_a(chip: str, rate_hz: float, bias: int = 0, averaging: int = 0) -> int:
    """Configuration register A; temperature compensation where the chip has it."""
    compensation = TEMPERATURE_COMPENSATION if chip == "hmc5983" else 0
    return compensation | averaging | OUTPUT_RATE_HZ.index(output_rate_hz(chip, rate_hz)) << 2 | bias


def config_b(gain_code: int) -> int:
    return gain_code << 5


def axes_from_registers(block: bytes) -> Axes:
    """Counts (x, y, z) of the six data registers: big-endian, in the chip's order X, Z, Y."""
    x, z, y = _AXES.unpack(block)
    return x, y, z


def temperature_c(raw: int) -> float:
    return 25.0 + raw / 128.0


def why_not_identity(answer: bytes) -> str | None:
    """What is wrong with the three identification registers, None if nothing is.

    Necessary, not sufficient: a QMC5883L clone may answer the same, and fails the self-test.
    """
    if answer == IDENTITY:
        return None
    return (
        f"answers {answer.hex(' ')} where an HMC5983 says 48 34 33 (H43): another chip is fitted, or the bus is noisy"
    )


def strap_counts(unbiased: Axes, positive: Axes, negative: Axes) -> tuple[Axes, Axes]:
    """What the bias strap alone did, from the counts without and with either bias; OVERFLOW_COUNT where one saturated.

    The data sheet says that the chip subtracts the external field itself; then positive and negative are symmetric
    about zero. A chip that does not shows them symmetric about the unbiased reading. Whichever is nearer is taken off,
    axis by axis, as in firmware/core/hmc5983.c: a strap that does nothing fails on both kinds.
    """
    axes = [_strap_axis(*counts) for counts in zip(unbiased, positive, negative, strict=True)]
    (x, y, z), (x_down, y_down, z_down) = zip(*axes, strict=True)
    return (x, y, z), (x_down, y_down, z_down)


def _strap_axis(unbiased: int, plus: int, minus: int) -> tuple[int, int]:
    if OVERFLOW_COUNT in (unbiased, plus, minus):
        return OVERFLOW_COUNT, OVERFLOW_COUNT
    twice_the_centre = plus + minus
    external = unbiased if abs(twice_the_centre - 2 * unbiased) < abs(twice_the_centre) else 0
    return plus - external, minus - external


def selftest_limits(gain_code: int) -> tuple[int, int]:
    """Least and largest count of a good axis: the data sheet's, scaled from gain code 5."""
    scale = LSB_PER_GAUSS[gain_code] / LSB_PER_GAUSS[SELFTEST_GAIN_CODE]
    low, high = SELFTEST_LIMITS
    return round(low * scale), round(high * scale)


def selftest_facts(
    gain_code: int, positive: Sequence[Axes], negative: Sequence[Axes], faults: Sequence[str | None] = ()
) -> dict[str, object]:
    """What a bias-strap measurement tells: per sensor and axis counts, gain relative to nominal, and what failed.

    positive, negative: counts per sensor under either bias, the external field subtracted.
    faults: per sensor, why there is no measurement at all.
    `gain_factor` multiplies the nominal counts per gauss of an axis; None where its counts are out of limits.
    """
    sensors = []
    for index, (up, down) in enumerate(zip(positive, negative, strict=True)):
        fault = faults[index] if faults else None
        failures = [fault] if fault else selftest_failures(gain_code, up, down)
        factors: list[float | None] = [
            (plus - minus) / 2 / (strap * LSB_PER_GAUSS[gain_code])
            if not fault and _axis_failure(gain_code, plus, minus) is None
            else None
            for plus, minus, strap in zip(up, down, STRAP_GAUSS, strict=True)
        ]
        sensors.append(
            {
                "sensor": index + 1,
                "passed": not failures,
                "failures": failures,
                "positive_counts": list(up),
                "negative_counts": list(down),
                "gain_factor": factors,
            }
        )
    return {"gain_code": gain_code, "passed": all(one["passed"] for one in sensors), "sensors": sensors}


def selftest_failures(gain_code: int, up: Axes, down: Axes) -> list[str]:
    """What is wrong with one sensor's counts under the positive and the negative bias; empty if nothing is."""
    reasons = [_axis_failure(gain_code, plus, minus) for plus, minus in zip(up, down, strict=True)]
    return [f"{axis}: {reason}" for axis, reason in zip("xyz", reasons, strict=True) if reason]


def _axis_failure(gain_code: int, plus: int, minus: int) -> str | None:
    low, high = selftest_limits(gain_code)
    if OVERFLOW_COUNT in (plus, minus):
        return "saturated: the field outside leaves no room for the bias; move the magnet away and repeat"
    if not (low <= plus <= high and low <= -minus <= high):
        return f"{plus:+d} and {minus:+d} counts under the bias, where ±{low} to ±{high} are due: the chip is damaged"
    return None
