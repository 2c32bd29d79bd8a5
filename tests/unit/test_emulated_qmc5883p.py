"""The emulated QMC5883P against what public drivers say of it, register by register, without any driver.

ArduPilot AP_Compass_QMC5883P, Adafruit_QMC5883P, lionyhw/MQC5883P_nrf52, reznikmm/qmc5883p (which quotes the data
sheet). What none of them says is in the head of emulator/qst.py.
"""

from __future__ import annotations

import statistics
from typing import Any

import pytest
from emulated_bus import Clock, read

from emulator.magnetometers import Qmc5883p

FIELD_GAUSS = (0.75, -1.5, 0.3)
STATUS, CONTROL_1, CONTROL_2, SIGNS = 0x09, 0x0A, 0x0B, 0x29
NORMAL, SINGLE, CONTINUOUS = 1, 2, 3
READY, OVERFLOW = 1, 2


@pytest.fixture
def clock() -> Clock:
    return Clock()


def made(clock: Clock, mode: int = NORMAL, field_gauss: tuple[float, ...] = FIELD_GAUSS, **own: Any) -> Qmc5883p:
    """Set up as the data sheet's examples do it, at 200 Hz, ±2 G unless own says otherwise."""
    range_code = own.pop("range_code", 3)
    chip = Qmc5883p(clock, field_gauss)
    for name, value in own.items():
        assert hasattr(chip, name)
        setattr(chip, name, value)
    for register, value in ((SIGNS, 0x06), (CONTROL_2, range_code << 2), (CONTROL_1, 3 << 2 | mode)):
        chip.write(bytes((register, value)))
    return chip


def counts(chip: Qmc5883p) -> list[int]:
    data = read(chip, 0x01, 6)
    return [int.from_bytes(data[at : at + 2], "little", signed=True) for at in (0, 2, 4)]


def test_answers_at_0x2c_with_identity_0x80(clock: Clock) -> None:
    chip = Qmc5883p(clock)
    assert chip.address == 0x2C
    assert read(chip, 0x00) == b"\x80"


@pytest.mark.parametrize(("code", "lsb"), [(0, 1000), (1, 2500), (2, 3750), (3, 15000)])
def test_counts_per_gauss_of_each_range(clock: Clock, code: int, lsb: int) -> None:
    chip = made(clock, range_code=code)
    clock.sleep(5.1e-3)
    assert counts(chip) == [round(each * lsb) for each in FIELD_GAUSS]


@pytest.mark.parametrize(("code", "rate_hz"), list(enumerate((10, 50, 100, 200))))
def test_normal_mode_keeps_its_rate_and_suspend_ends_it(clock: Clock, code: int, rate_hz: int) -> None:
    chip = made(clock)
    chip.write(bytes((CONTROL_1, code << 2 | NORMAL)))
    clock.sleep(0.99 / rate_hz)
    assert read(chip, STATUS)[0] & READY == 0
    clock.sleep(0.02 / rate_hz)
    assert read(chip, STATUS)[0] & READY == READY
    clock.sleep(1.0)
    read(chip, STATUS)
    assert chip.conversions == rate_hz + 1
    chip.write(bytes((CONTROL_1, 0)))
    clock.sleep(1.0)
    read(chip, STATUS)
    assert chip.conversions == rate_hz + 1


@pytest.mark.parametrize("cleared_by", ["status", "data"])
def test_ready_is_cleared_by_the_status_or_by_the_data(clock: Clock, cleared_by: str) -> None:
    chip = made(clock, SINGLE, cleared_by=cleared_by)
    clock.sleep(5.1e-3)
    counts(chip)
    if cleared_by == "status":
        assert read(chip, STATUS) == bytes((READY,))
    assert read(chip, STATUS) == b"\x00"
    chip = made(clock, SINGLE, cleared_by=cleared_by)
    clock.sleep(5.1e-3)
    assert read(chip, STATUS) == bytes((READY,))
    assert read(chip, STATUS) == (b"\x00" if cleared_by == "status" else bytes((READY,)))
    counts(chip)
    assert read(chip, STATUS) == b"\x00"


@pytest.mark.parametrize(
    ("gauss", "shown", "flag"), [(1.99, 29850, 0), (2.01, 30150, 2), (-2.5, -32768, 2), (9, 32767, 2)]
)
def test_overflow_begins_at_30000_counts_and_saturates(clock: Clock, gauss: float, shown: int, flag: int) -> None:
    chip = made(clock, SINGLE, (0.5, gauss, 0.5))
    clock.sleep(5.1e-3)
    assert counts(chip) == [7500, shown, 7500]
    assert read(chip, STATUS)[0] & OVERFLOW == flag
    assert read(chip, STATUS)[0] & OVERFLOW == 0  # "cleared after this bit is read"


def test_axes_are_turned_until_the_signs_are_defined(clock: Clock) -> None:
    chip = made(clock)
    right = [11250, -22500, 4500]
    chip.write(bytes((CONTROL_2, 0x80)))  # a soft reset forgets the signs
    for signs, is_right in ((0x05, False), (0x06, True)):
        chip.write(bytes((SIGNS, signs)))
        chip.write(bytes((CONTROL_2, 3 << 2)))
        chip.write(bytes((CONTROL_1, 3 << 2 | SINGLE)))
        clock.sleep(5.1e-3)
        assert (counts(chip) == right) == is_right
        assert [abs(each) for each in counts(chip)] == [abs(each) for each in right]
        assert read(chip, SIGNS) == b"\x00"  # the register cannot be read back


def test_single_mode_measures_once_and_ends_in_suspend(clock: Clock) -> None:
    chip = made(clock, SINGLE)
    clock.sleep(5.1e-3)
    assert read(chip, STATUS)[0] & READY == READY
    assert read(chip, CONTROL_1)[0] & 3 == 0
    clock.sleep(1.0)
    read(chip, STATUS)
    assert chip.conversions == 1


def test_continuous_mode_is_not_slower_than_normal(clock: Clock) -> None:
    chip = made(clock, CONTINUOUS)
    chip.write(bytes((CONTROL_1, CONTINUOUS)))
    clock.sleep(1.0001)
    read(chip, STATUS)
    assert chip.conversions >= 200


def test_soft_reset_restores_suspend_and_the_widest_range(clock: Clock) -> None:
    chip = made(clock)
    chip.write(bytes((CONTROL_2, 0x80)))
    assert read(chip, CONTROL_1, 2) == b"\x00\x00"
    clock.sleep(1.0)
    assert read(chip, STATUS) == b"\x00"
    assert chip.conversions == 0


def test_noise_is_2_mg_at_2_gauss(clock: Clock) -> None:
    chip = made(clock, field_gauss=(0.0, 0.0, 0.0), has_own_noise=True)
    samples = []
    for _ in range(700):
        clock.sleep(5e-3)
        samples += counts(chip)
    assert statistics.pstdev(samples) / 15000 == pytest.approx(2e-3, rel=0.06)
