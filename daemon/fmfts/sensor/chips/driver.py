"""The interface to a chip on an I2C bus, which each file of this folder implements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from fmfts.sensor.chips.chip import Axes, Chip

IDENTITY_BYTES = 3  # the limit of the wire (firmware/wire.md, hello)


def transfer_bits(written: int, read: int = 0) -> int:
    """Bit times of one transfer: START, address and acknowledge, bytes with theirs, STOP; the same again to read."""
    return 1 + 9 * (1 + written) + (1 + 9 * (1 + read) if read else 0) + 1


class Setup(NamedTuple):
    """Settings of a chip. single: triggered measurements, instead of its own stream."""

    gain_code: int
    rate_hz: float
    single: bool


class Wires(Protocol):
    """The bus as one chip sees it. Every failure raises OSError."""

    def write(self, data: bytes) -> None:
        """One transfer."""

    def exchange(self, data: bytes, count: int) -> bytes:
        """Write `data`, then read `count` bytes after a repeated start: one transfer.

        No other kind of transfer: the kernel's driver of the Raspberry Pi 1 to 4 (i2c-bcm2835) refuses one that reads
        before its end, and others refuse one that reads twice.
        """


# Yields registers of a chip: the number of the first, and the bytes from there on.
Dump = Callable[[Wires], Iterator[tuple[int, bytes]]]


def registers(*blocks: tuple[int, int], advance: int = 0) -> Dump:
    """Reads blocks of registers, each of (first number, bytes) in one transfer.

    Reading a block must be harmless: for example, all data registers of a chip that locks its output until the last one
    was read. advance: the bit that makes the number grow within a transfer.
    """

    def dump(wires: Wires) -> Iterator[tuple[int, bytes]]:
        for first, count in blocks:
            yield first, wires.exchange(bytes((advance | first,)), count)

    return dump


class Driver(Protocol):
    """The registers of one kind of chip. It keeps no state: a chip may be unplugged and changed at any time.

    sample_bits, trigger_bits: bit times on the wires of `sample`, and of writing `trigger` to one chip.
    trigger: starts one measurement; empty where the chip only streams.
    stale_samples: how many samples after `set_up` still have the old settings.
    """

    sample_bits: int
    trigger_bits: int
    stale_samples: int

    @property
    def trigger(self) -> bytes: ...

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        """Its IDENTITY_BYTES, for `Chip.is_identity`. A chip of another kind keeps its settings."""

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """Configure it. False if its registers do not hold what was written."""

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """The registers still hold what `set_up` wrote: a brown-out changes them silently."""

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        """Whether the chip says that a sample is new, and the sample; None if it has none to give now."""

    def axes(self, chip: Chip, block: bytes) -> Axes:
        """Counts (x, y, z) of a sample, `chip.saturated_count` where an axis is beyond its range."""

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        """The thermometer's reading, or None. block: the newest sample, which holds it on some chips."""


def saturating(chip: Chip, counts: Axes) -> Axes:
    """`counts` with the axes marked that are beyond the chip's range, whose counts are meaningless."""
    x, y, z = (count if abs(count) <= chip.largest_count else chip.saturated_count for count in counts)
    return x, y, z


def overflowing(chip: Chip, counts: Axes, overflow: bool) -> Axes:
    """`saturating`, where a flag says that any axis overflowed: if none shows which one, all of them are marked."""
    marked = saturating(chip, counts)
    if overflow and chip.saturated_count not in marked:
        return chip.saturated_count, chip.saturated_count, chip.saturated_count
    return marked
