"""The emulated MMC5983MA against its data sheet, register by register, without any driver.

The data sheet could not be read here: what stands here of it, public drivers say alike (docs/chips.md).
"""

from __future__ import annotations

import pytest
from emulated_bus import Clock, read

from emulator.magnetometers import Mmc5983ma

FIELD_GAUSS = (0.75, -1.5, 0.3)
STATUS, CONTROL_0, CONTROL_1, CONTROL_2, CONTROL_3 = range(0x08, 0x0D)
MEASURE, SET, RESET, AUTOMATIC = 0x01, 0x08, 0x10, 0x20


@pytest.fixture
def clock() -> Clock:
    return Clock()


def measured(clock: Clock, chip: Mmc5983ma, *bits: int) -> list[float]:
    """x, y, z in gauss of all 18 bits, of one measurement with these bits of control 0."""
    chip.write(bytes((CONTROL_0, MEASURE | sum(bits))))
    clock.sleep(8.1e-3)
    *axes, low = read(chip, 0x00, 7)
    counts = [axes[2 * i] << 10 | axes[2 * i + 1] << 2 | low >> 6 - 2 * i & 3 for i in range(3)]
    return [(count - 131072) / 16384 for count in counts]


def pulse(chip: Mmc5983ma, bit: int) -> None:
    chip.write(bytes((CONTROL_0, bit)))


@pytest.mark.parametrize(("code", "duration_s"), list(enumerate((8e-3, 4e-3, 2e-3, 0.5e-3))))
def test_measures_as_long_as_its_bandwidth_says(clock: Clock, code: int, duration_s: float) -> None:
    chip = Mmc5983ma(clock, FIELD_GAUSS)
    chip.write(bytes((CONTROL_1, code)))
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(0.99 * duration_s)
    assert read(chip, STATUS) == b"\x10"
    clock.sleep(0.02 * duration_s)
    assert read(chip, STATUS) == b"\x11"
    read(chip, 0x00, 7)
    assert read(chip, STATUS) == b"\x11"  # until it is cleared, or another begins
    chip.write(bytes((STATUS, 0x00)))
    assert read(chip, STATUS) == b"\x11"
    chip.write(bytes((STATUS, 0x01)))
    assert read(chip, STATUS) == b"\x10"
    clock.sleep(1.0)
    assert read(chip, STATUS) == b"\x10"  # it was one alone
    measured(clock, chip)
    chip.write(bytes((CONTROL_0, MEASURE)))
    assert read(chip, STATUS) == b"\x10"


def test_streams_only_with_a_rate_and_the_bit(clock: Clock) -> None:
    for control_2, samples in ((0x08, 0), (0x05, 0), (0x0D, 100), (0x0C, 50)):
        chip = Mmc5983ma(clock)
        chip.write(bytes((CONTROL_2, control_2)))
        clock.sleep(1.0001)
        read(chip, STATUS)
        assert chip.conversions == samples


def test_has_18_bits_about_the_middle_and_its_z_points_into_the_board(clock: Clock) -> None:
    chip = Mmc5983ma(clock, (5 / 16384, -6.5, 7 / 16384))
    assert measured(clock, chip) == [5 / 16384, -6.5, -7 / 16384]


def test_stops_at_either_end_of_its_counts(clock: Clock) -> None:
    chip = Mmc5983ma(clock, (8.5, -8.5, 0.0))
    assert measured(clock, chip) == [131071 / 16384, -8.0, 0.0]


def test_settings_cannot_be_read_back(clock: Clock) -> None:
    chip = Mmc5983ma(clock)
    chip.write(bytes((CONTROL_0, AUTOMATIC, 0x02, 0x8D, 0x40)))
    assert read(chip, CONTROL_0, 4) != b"\x20\x02\x8d\x40"
    assert len(set(read(chip, CONTROL_0, 4))) == 1


def test_hears_nothing_while_it_starts(clock: Clock) -> None:
    chip = Mmc5983ma(clock)
    chip.write(bytes((CONTROL_1, 0x80)))
    clock.sleep(5e-3)
    chip.write(bytes((CONTROL_0, MEASURE)))
    clock.sleep(20e-3)
    assert read(chip, STATUS) == b"\x10"
    assert read(chip, 0x00, 6) == bytes(6)  # nothing was measured since


def test_reset_turns_over_the_field_and_not_the_zero(clock: Clock) -> None:
    chip = Mmc5983ma(clock, (0.75, -1.5, 0.25))
    chip.zero_gauss = (0.25, 0.125, -0.5)
    pulse(chip, SET)
    assert measured(clock, chip) == [1.0, -1.375, -0.75]
    pulse(chip, RESET)
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]  # until the next pulse
    chip.write(bytes((CONTROL_1, 0x80)))  # registers start anew, the bridges stay as they are
    clock.sleep(10e-3)
    assert measured(clock, chip) == [-0.5, 1.625, -0.25]
    assert measured(clock, chip, AUTOMATIC) == [1.0, -1.375, -0.75]


def test_automatic_set_of_a_stream_needs_its_own_bit(clock: Clock) -> None:
    for control_2, first in ((0x0D, -0.75), (0x8D, 0.75)):
        chip = Mmc5983ma(clock, (0.75, 0.0, 0.0))
        pulse(chip, RESET)
        chip.write(bytes((CONTROL_0, AUTOMATIC, 0x00, control_2)))
        clock.sleep(10.1e-3)
        count = int.from_bytes(read(chip, 0x00, 2), "big")
        assert (count - 32768) / 4096 == first


def test_stays_magnetised_after_a_strong_field_until_a_pulse(clock: Clock) -> None:
    chip = Mmc5983ma(clock, (0.5, 0.0, 0.0))
    chip.feel((9.9, 0.0, 0.0))
    measured(clock, chip)
    chip.feel((0.5, 0.0, 0.0))
    assert measured(clock, chip) == [0.5, 0.0, 0.0]
    for bit, field in ((SET, 0.5), (RESET, -0.5)):
        chip.feel((0.0, 10.1, 0.0))
        measured(clock, chip)
        chip.feel((0.5, 0.0, 0.0))
        assert measured(clock, chip) != [0.5, 0.0, 0.0]
        pulse(chip, bit)
        assert measured(clock, chip) == [field, 0.0, 0.0]
        pulse(chip, SET)


@pytest.mark.parametrize(("bits", "way"), [(0x00, 0), (0x02, 1), (0x04, -1)])
def test_coil_makes_a_field_that_the_bridges_feel_as_any_other(clock: Clock, bits: int, way: int) -> None:
    chip = Mmc5983ma(clock)
    chip.coil_gauss = (0.125, -0.0625, 0.1875)
    chip.write(bytes((CONTROL_3, bits)))
    for bit, sense in ((SET, 1), (RESET, -1)):
        pulse(chip, bit)
        assert measured(clock, chip) == [sense * way * each for each in chip.coil_gauss]
