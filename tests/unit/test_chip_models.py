"""The emulated chips behave as the data sheets say; tests against them are only as good as they are."""

from __future__ import annotations

import pytest

from emulator.chips import Bus, Hmc5983, NackError, Tca9548a


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def axes(block: bytes) -> tuple[int, ...]:
    return tuple(int.from_bytes(block[i : i + 2], "big", signed=True) for i in (0, 4, 2))


def measured(chip: Hmc5983, clock: Clock) -> tuple[int, ...]:
    clock.now_s += 0.3
    chip.write(b"\x03")
    return axes(chip.read(6))


def continuous(clock: Clock, gain_code: int = 1, **options: object) -> Hmc5983:
    chip = Hmc5983(clock, (0.5, -0.25, 1.0), **options)  # type: ignore[arg-type]
    chip.write(bytes((0, 0x9C, gain_code << 5, 0)))
    return chip


def test_registers_after_reset_and_which_of_them_can_be_written(clock: Clock) -> None:
    chip = Hmc5983(clock)
    chip.write(b"\x00" + bytes(range(0x50, 0x5D)))
    chip.write(b"\x0a")
    assert chip.read(3) == b"H43"
    chip.power_on()
    chip.write(b"\x00")
    assert chip.read(3) == bytes((0x10, 0x20, 0x01))


def test_counts_come_as_x_z_y_big_endian_at_the_gain_in_force(clock: Clock) -> None:
    chip = continuous(clock)
    assert measured(chip, clock) == (545, -272, 1090)  # 1090 counts per gauss


def test_first_sample_after_a_gain_change_has_the_old_gain(clock: Clock) -> None:
    chip = continuous(clock, gain_code=3)
    clock.now_s += 2.5 / 220
    chip.write(b"\x03")
    assert axes(chip.read(6)) == (545, -272, 1090)
    assert measured(chip, clock) == (330, -165, 660)


def test_partial_read_locks_the_output_until_all_six_are_read(clock: Clock) -> None:
    chip = continuous(clock)
    before = measured(chip, clock)
    chip.write(b"\x03")
    first = chip.read(2)
    chip.field_gauss = [0.0, 0.0, 0.0]
    clock.now_s += 1.0
    chip.write(b"\x09")
    assert chip.read(1)[0] & 2
    chip.write(b"\x05")
    assert axes(first + chip.read(4)) == before
    assert measured(chip, clock) == (0, 0, 0)


def test_reading_the_mode_register_locks_too(clock: Clock) -> None:
    chip = continuous(clock)
    before = measured(chip, clock)
    chip.write(b"\x02")
    chip.read(1)
    chip.field_gauss = [0.0, 0.0, 0.0]
    assert measured(chip, clock) == before
    assert measured(chip, clock) == (0, 0, 0)


def test_ready_is_set_by_a_conversion_and_cleared_by_reading(clock: Clock) -> None:
    chip = continuous(clock)
    chip.write(b"\x09")
    assert chip.read(1)[0] & 1 == 0
    measured(chip, clock)
    chip.write(b"\x09")
    assert chip.read(1)[0] & 1 == 0
    clock.now_s += 1 / 200
    chip.write(b"\x09")
    assert chip.read(1)[0] & 1 == 1


@pytest.mark.parametrize("error", [-0.03, 0.03])
def test_each_chip_runs_on_its_own_clock(clock: Clock, error: float) -> None:
    chip = continuous(clock, clock_error=error)
    for _ in range(10_000):
        clock.now_s += 0.001
        chip.write(b"\x09")
        chip.read(1)
    assert chip.conversions == pytest.approx(2200 / (1 + error), abs=3)


def test_field_beyond_the_range_reads_minus_4096_on_that_axis(clock: Clock) -> None:
    chip = continuous(clock)
    chip.field_gauss = [0.1, 3.0, -0.1]
    assert measured(chip, clock) == (109, -4096, -109)


def test_bias_test_subtracts_the_ambient_field_unless_saturated(clock: Clock) -> None:
    chip = Hmc5983(clock, (0.5, -0.25, 4.5))
    for bias, expected in ((1, (452, 452, -4096)), (2, (-452, -452, -421))):
        chip.write(bytes((0, 0x70 | bias, 5 << 5, 0)))
        measured(chip, clock)
        assert measured(chip, clock) == expected


def test_channel_opens_at_the_stop_and_not_before(clock: Clock) -> None:
    bus = Bus([Tca9548a(0x70, {0: Hmc5983(clock)})])
    with pytest.raises(NackError):
        bus.transfer([(0x70, b"\x01"), (0x1E, b"\x0a"), (0x1E, 3)])
    bus.transfer([(0x70, b"\x00")])
    bus.transfer([(0x70, b"\x01")])
    assert bus.transfer([(0x1E, b"\x0a"), (0x1E, 3)])[1] == b"H43"
    assert bus.transfer([(0x70, 1)]) == [b"\x01"]


def test_two_open_channels_share_writes_and_wire_and_reads(clock: Clock) -> None:
    chips = {0: Hmc5983(clock, (0.5, 0, 0)), 1: Hmc5983(clock, (0.25, 0, 0))}
    bus = Bus([Tca9548a(0x70, chips)])
    bus.transfer([(0x70, b"\x03")])
    bus.transfer([(0x1E, bytes((0, 0x9C, 0x20, 0)))])
    clock.now_s = 1.0
    _, block = bus.transfer([(0x1E, b"\x03"), (0x1E, 6)])
    assert axes(block)[0] == 545 & 272
    assert bus.muxes[0].conflicts == 1
