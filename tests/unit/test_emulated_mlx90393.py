"""The emulated MLX90393 by itself, without a driver: what commands, status and registers do."""

from __future__ import annotations

import pytest
from emulated_bus import Clock

from emulator.mlx90393 import Mlx90393

ALL, BURST, SINGLE, READ, READ_REGISTER, EXIT, RESET = 0x0F, 0x1F, 0x3F, 0x4F, 0x50, 0x80, 0xF0
ERROR, IN_BURST, IN_SINGLE, WAS_RESET = 0x10, 0x80, 0x20, 0x04
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


def test_a_reset_restores_the_registers_and_the_status_shows_it_until_the_next_mode() -> None:
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


def test_a_measurement_is_handed_out_once_and_only_when_it_ended() -> None:
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
