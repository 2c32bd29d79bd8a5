"""The emulated MMC5603NJ against what public drivers say of it, register by register, without any driver.

Linux drivers/iio/magnetometer/mmc5633, Zephyr drivers/sensor/memsic/mmc56x3, Adafruit_MMC56x3, mgershow/MMC5603NJ,
PebbleOS. Its film is that of the MMC5983MA (test_emulated_mmc5983ma.py); here is what differs.
"""

from __future__ import annotations

import statistics
from typing import Any

import pytest
from emulated_bus import Clock, read

from emulator.magnetometers import Mmc5603nj

FIELD_GAUSS = (0.75, -1.5, 0.25)
AFTER_SET = [0.75, -1.5, -0.25]  # left-handed: unverified
STATUS, RATE, CONTROL_0, CONTROL_1, CONTROL_2 = 0x18, 0x1A, 0x1B, 0x1C, 0x1D
MEASURE, SET, RESET, AUTOMATIC, SELF_TEST, RATE_TAKEN = 0x01, 0x08, 0x10, 0x20, 0x40, 0x80
DONE, SATURATED = 0x40, 0x20


@pytest.fixture
def clock() -> Clock:
    return Clock()


def made(clock: Clock, field_gauss: tuple[float, ...] = FIELD_GAUSS, bandwidth: int = 2, **own: Any) -> Mmc5603nj:
    """A chip after SET, whose pulses repeat exactly unless `own` says how well they do."""
    chip = Mmc5603nj(clock, field_gauss)
    chip.repeatability_gauss = 0.0
    for name, value in own.items():
        assert hasattr(chip, name)
        setattr(chip, name, value)
    chip.write(bytes((CONTROL_1, bandwidth)))
    pulse(clock, chip, SET)
    return chip


def pulse(clock: Clock, chip: Mmc5603nj, bit: int, pause_s: float = 1e-3) -> None:
    chip.write(bytes((CONTROL_0, bit)))
    clock.sleep(pause_s)


def measured(clock: Clock, chip: Mmc5603nj, *bits: int) -> list[float]:
    """x, y, z in gauss of all 20 bits."""
    chip.write(bytes((CONTROL_0, MEASURE | sum(bits))))
    clock.sleep(14e-3)
    assert is_done(chip)
    data = read(chip, 0x00, 9)
    counts = [data[2 * i] << 12 | data[2 * i + 1] << 4 | data[6 + i] >> 4 for i in range(3)]
    assert all(each & 0x0F == 0 for each in data[6:])
    return [(count - 524288) / 16384 for count in counts]


def is_done(chip: Mmc5603nj) -> bool:
    return bool(read(chip, STATUS)[0] & DONE)


def test_identity_is_0x10_at_0x39(clock: Clock) -> None:
    chip = Mmc5603nj(clock)
    assert chip.address == 0x30
    assert read(chip, 0x39) == b"\x10"
    assert read(chip, 0x2F) != b"\x30"  # that is the MMC5983MA's


@pytest.mark.parametrize(("bandwidth", "milliseconds"), list(enumerate((6.6, 3.5, 2.0, 1.2))))
@pytest.mark.parametrize("samples", [1, 2])
def test_measurement_takes_the_time_of_its_bandwidth(
    clock: Clock, bandwidth: int, milliseconds: float, samples: int
) -> None:
    chip = made(clock, bandwidth=bandwidth)
    measured(clock, chip)
    chip.write(bytes((CONTROL_0, MEASURE | (AUTOMATIC if samples == 2 else 0))))
    assert not is_done(chip)
    clock.sleep(0.99e-3 * samples * milliseconds)
    assert not is_done(chip)
    clock.sleep(0.02e-3 * samples * milliseconds)
    assert is_done(chip)


@pytest.mark.parametrize(
    ("field", "shown"), [(5 / 16384, 5 / 16384), (29.5, 29.5), (33.0, 524287 / 16384), (-33.0, -32.0)]
)
def test_mmc5603nj_counts_20_bits_about_the_middle(clock: Clock, field: float, shown: float) -> None:
    chip = made(clock, (field, -0.5, 7 / 16384), upsetting_gauss=100.0)
    assert measured(clock, chip) == [shown, -0.5, -7 / 16384]


def test_reset_takes_20_ms(clock: Clock) -> None:
    chip = made(clock)
    for wait_s, hears in ((19.9e-3, False), (20e-3, True)):
        clock.sleep(1.0)
        chip.write(bytes((CONTROL_1, 0x80)))
        clock.sleep(wait_s)
        chip.write(bytes((CONTROL_0, MEASURE)))
        clock.sleep(6.7e-3)  # bandwidth 00
        assert is_done(chip) == hears


def test_pulses_turn_the_field_and_not_the_zero(clock: Clock) -> None:
    chip = made(clock, zero_gauss=(0.25, 0.125, -0.5))
    assert measured(clock, chip) == [1.0, -1.375, -0.75]
    pulse(clock, chip, RESET)
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]
    assert measured(clock, chip, AUTOMATIC) == AFTER_SET
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]  # automatic set/reset ends with RESET


def test_measurement_within_1_ms_after_a_pulse_is_wrong(clock: Clock) -> None:
    """tSR, which two drivers quote from Rev. B, page 15."""
    for pause_s, is_right in ((0.0, False), (0.5e-3, False), (0.9e-3, False), (1e-3, True)):
        chip = made(clock)
        pulse(clock, chip, SET, pause_s)
        assert (measured(clock, chip) == AFTER_SET) == is_right


def test_film_keeps_its_state_up_to_its_range(clock: Clock) -> None:
    for gauss, upset in ((-30.0, False), (32.5, True)):
        chip = made(clock)
        chip.feel((0.0, gauss, 0.0))
        chip.feel(FIELD_GAUSS)
        assert (measured(clock, chip) != AFTER_SET) == upset
        measured(clock, chip, SELF_TEST)
        assert bool(read(chip, STATUS)[0] & SATURATED) == upset
        pulse(clock, chip, SET)
        assert measured(clock, chip, SELF_TEST) == AFTER_SET
        assert read(chip, STATUS)[0] & SATURATED == 0


def test_command_0x21_is_accepted_by_the_mmc5603nj(clock: Clock) -> None:
    chip = made(clock)
    assert all(measured(clock, chip, AUTOMATIC) == AFTER_SET for _ in range(64))


@pytest.mark.parametrize(("bits", "way"), [(0x00, 0), (0x20, 1), (0x40, -1)])
def test_coil_makes_a_field(clock: Clock, bits: int, way: int) -> None:
    chip = made(clock, (0.0, 0.0, 0.0), coil_gauss=(0.125, -0.0625, 0.1875))
    chip.write(bytes((CONTROL_1, 2 | bits)))
    assert measured(clock, chip) == [way * each for each in chip.coil_gauss]


@pytest.mark.parametrize(("bit", "axis"), [(0x04, 0), (0x08, 1), (0x10, 2)])
def test_inhibited_axis_keeps_its_old_output(clock: Clock, bit: int, axis: int) -> None:
    chip = made(clock)
    measured(clock, chip)
    chip.write(bytes((CONTROL_1, 2 | bit)))
    chip.feel((0.5, 0.5, -0.5))
    assert measured(clock, chip) == [AFTER_SET[axis] if each == axis else 0.5 for each in range(3)]


@pytest.mark.parametrize(("bandwidth", "fastest_hz"), list(enumerate((75, 150, 255, 255))))
def test_continuous_mode_needs_all_three_settings(clock: Clock, bandwidth: int, fastest_hz: int) -> None:
    for rate, control_0, control_2, samples in (
        (50, RATE_TAKEN | AUTOMATIC, 0x10, 50),
        (255, RATE_TAKEN | AUTOMATIC, 0x10, fastest_hz),
        (50, AUTOMATIC, 0x10, 0),
        (50, RATE_TAKEN, 0x00, 0),
        (0, RATE_TAKEN, 0x10, 0),
    ):
        chip = made(clock, bandwidth=bandwidth)
        chip.write(bytes((RATE, rate)))
        chip.write(bytes((CONTROL_0, control_0)))
        chip.write(bytes((CONTROL_2, control_2)))
        clock.sleep(1.0001)
        is_done(chip)
        assert chip.conversions == samples


@pytest.mark.parametrize(("bandwidth", "milliseconds"), list(enumerate((6.6, 3.5, 2.0, 1.2))))
def test_noise_grows_with_the_square_root_of_the_bandwidth(clock: Clock, bandwidth: int, milliseconds: float) -> None:
    chip = made(clock, (0.0, 0.0, 0.0), bandwidth, has_own_noise=True)
    noise = [each for _ in range(700) for each in measured(clock, chip)]
    assert statistics.pstdev(noise) == pytest.approx(2e-3 * (6.6 / milliseconds) ** 0.5, rel=0.06)
