"""The emulated MLX90393 by itself, without a driver: what commands, status and registers do."""

from __future__ import annotations

import pytest
from emulated_bus import Clock

from emulator.mlx90393 import Mlx90393

ALL, BURST, SINGLE, READ, READ_REGISTER, EXIT, RESET = 0x0F, 0x1F, 0x3F, 0x4F, 0x50, 0x80, 0xF0
ERROR, IN_BURST, IN_SINGLE, WAS_RESET = 0x10, 0x80, 0x20, 0x04
FACTORY_7 = 0x067C  # the factory's bits, GAIN_SEL 7, HALLCONF 0xC
LONGER_THAN_ANY_S = 0.5  # a conversion of three axes with OSR 3 and DIG_FILT 7 takes 0.2 s


class Bench:
    def __init__(self, field_gauss: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> None:
        self.clock = Clock()
        self.chip = Mlx90393(self.clock, field_gauss=field_gauss)

    def tell(self, *command: int, count: int = 1) -> bytes:
        self.chip.write(bytes(command))
        return self.chip.read(count)

    def set(self, number: int, value: int) -> int:
        return self.tell(0x60, value >> 8, value & 0xFF, number << 2)[0]

    def register(self, number: int) -> int:
        return int.from_bytes(self.tell(READ_REGISTER, number << 2, count=3)[1:], "big")

    def wait(self, seconds: float = LONGER_THAN_ANY_S) -> None:
        self.clock.sleep(seconds)

    def x_counts(self, resolution: int) -> int:
        self.set(2, resolution * 0b10101 << 5 | 3 << 2)
        self.tell(SINGLE)
        self.wait()
        return int.from_bytes(self.tell(READ, count=9)[3:5], "big")


def test_reset_restores_registers_and_status_shows_it_until_next_mode() -> None:
    bench = Bench()
    bench.set(2, 0x0540)
    assert bench.register(2) == 0x0540
    assert bench.tell(RESET)[0] & WAS_RESET
    assert [bench.register(number) for number in range(3)] == [0x067C, 0, 0]
    assert not bench.tell(EXIT)[0] & WAS_RESET


@pytest.mark.parametrize("hall", [0x0C, 0x00])
def test_forbidden_pairs_of_oversampling_and_filter_never_end_with_hallconf_c(hall: int) -> None:
    for oversampling in range(4):
        for filtered in range(8):
            bench = Bench()
            bench.set(0, 0x0670 | hall)
            bench.set(2, filtered << 2 | oversampling)
            bench.tell(SINGLE)
            bench.wait()
            ended = not bench.tell(READ, count=9)[0] & ERROR
            forbidden = hall == 0x0C and (oversampling, filtered) in {(0, 0), (0, 1), (1, 0)}
            assert ended != forbidden, (oversampling, filtered)


def test_measurement_is_handed_out_once_and_only_when_it_ended() -> None:
    bench = Bench()
    bench.set(2, 7 << 2)
    assert bench.tell(SINGLE)[0] & IN_SINGLE
    assert bench.tell(READ, count=9)[0] & ERROR
    bench.wait()
    assert not bench.tell(READ, count=9)[0] & ERROR
    assert bench.tell(READ, count=9)[0] & ERROR


def test_registers_are_neither_read_nor_written_in_a_burst() -> None:
    bench = Bench()
    bench.set(2, 0x055C)
    assert bench.tell(BURST)[0] & (IN_BURST | ERROR) == IN_BURST
    assert bench.tell(READ_REGISTER, 2 << 2, count=3)[0] & ERROR
    assert bench.set(2, 0) & ERROR
    bench.tell(EXIT)
    bench.wait()
    assert bench.register(2) == 0x055C


def test_resolution_zero_wraps_around_where_resolution_two_ends() -> None:
    """60 G are 40000 counts of 0.150 µT: beyond 32767 of RES 0, below 22000 of RES 2. 200 G are beyond both."""
    assert Bench((60.0, 0, 0)).x_counts(0) == 40000  # which reads as -25536
    assert Bench((60.0, 0, 0)).x_counts(2) == 0x8000 + 10000
    assert Bench((200.0, 0, 0)).x_counts(2) == 0x8000 + 22000
    assert Bench((200.0, 0, 0)).x_counts(0) == 88000 % 65536


def field_counts(bench: Bench, *start: int, reads_status: bool) -> list[int]:
    bench.chip.write(bytes(start))
    if reads_status:
        bench.chip.read(1)
    bench.wait()
    answer = bench.tell(READ, count=9)
    assert not answer[0] & ERROR
    return [int.from_bytes(answer[at : at + 2], "big") - 0x8000 for at in (3, 5, 7)]


@pytest.mark.parametrize("start", [BURST, SINGLE])
def test_first_start_after_a_reset_needs_its_status_read(start: int) -> None:
    """Rev. 002, page 16: else the measurement's data are not valid."""
    right = [round(100 / 0.601), round(200 / 0.601), round(100 / 0.968)]
    bench = Bench((1.0, 2.0, 1.0))

    def set_up() -> None:
        bench.tell(EXIT)
        bench.set(2, 0b101010 << 5 | 3 << 2)  # RES 2
        bench.set(0, FACTORY_7)

    for begin in (lambda: None, lambda: bench.tell(RESET), bench.chip.power_on):
        begin()
        set_up()
        assert field_counts(bench, start, reads_status=False) != pytest.approx(right, abs=2)
        bench.tell(EXIT)
        assert field_counts(bench, start, reads_status=False) != pytest.approx(right, abs=2)
        bench.tell(EXIT)
        assert field_counts(bench, start, reads_status=True) == pytest.approx(right, abs=2)
        bench.tell(EXIT)
        assert field_counts(bench, start, reads_status=False) == pytest.approx(right, abs=2)


@pytest.mark.parametrize("slowness", [1.0, 1.25])
def test_slow_part_takes_longer_than_the_table_says(slowness: float) -> None:
    """DIG_FILT 3, OSR 0: 3 axes of 67 + 64 * 10 us, 259 us of temperature, and 490 us. Adafruit's issues 17, 18."""
    table_s = (3 * (67 + 64 * 10) + 67 + 192 + 490) * 1e-6
    bench = Bench()
    bench.chip.slowness = slowness
    bench.set(2, 3 << 2)
    bench.tell(SINGLE)
    bench.wait(0.99 * slowness * table_s)
    assert bench.tell(READ, count=9)[0] & ERROR
    bench.wait(0.02 * slowness * table_s)
    assert not bench.tell(READ, count=9)[0] & ERROR


def test_axes_are_measured_one_after_the_other() -> None:
    """Rev. 002, page 13: t, x, y, z. A field that grows by 1000 G/s on all axes is older on x than on z."""
    bench = Bench()
    bench.set(0, FACTORY_7)
    bench.set(2, 0b101010 << 5 | 3 << 2)
    begin_s = bench.clock.now_s
    bench.chip.field_at = lambda time_s: (1000.0 * (time_s - begin_s),) * 3
    x, y, z = field_counts(bench, SINGLE, reads_status=True)
    axis_s = (67 + 64 * 10) * 1e-6
    at_x_s, at_y_s, at_z_s = x * 0.601e-5, y * 0.601e-5, z * 0.968e-5
    assert at_y_s - at_x_s == pytest.approx(axis_s, abs=20e-6)
    assert at_z_s - at_y_s == pytest.approx(axis_s, abs=20e-6)
    assert 0.5 * axis_s < at_x_s < 3 * axis_s
