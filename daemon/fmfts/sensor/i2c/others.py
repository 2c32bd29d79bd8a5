"""Finds which chips answer on a bus, independently of the configuration, so that a fault can name them."""

from __future__ import annotations

from collections.abc import Iterator

from fmfts.sensor.chips import CHIPS, Chip
from fmfts.sensor.i2c.bus import ChipWires, I2cBus


def identity_of_another(chip: Chip, bus: I2cBus, address: int | None = None) -> bytes | None:
    """The identification of another kind of chip that answers on the selected channel; None if there is none.

    address: ask only there.
    """
    found = (other.identity for other, _ in chips_answering(bus, address) if not chip.is_identity(other.identity))
    return next(found, None)


def chips_answering(bus: I2cBus, address: int | None = None) -> Iterator[tuple[Chip, int]]:
    """The chips on the selected channel, and the address of each. Kinds with the same identification count as one.

    Most kinds are asked by reading alone. An MLX90393 is asked by a command, which may end its measurement, and which
    another chip at its address (BMM150, LIS3DH, MCP9808) takes as a write to its register 0x50 or 0x80. So it is asked
    last, and not where another kind was found.
    """
    asked: set[tuple[bytes, int]] = set()
    taken: set[int] = set()
    for chip in sorted(CHIPS.values(), key=lambda one: one.asked_by_command):
        for where in chip.addresses:
            if (chip.identity, where) in asked or (address is not None and where != address):
                continue
            asked.add((chip.identity, where))
            if chip.asked_by_command and where in taken:
                continue
            try:
                answer = chip.driver.identify(ChipWires(bus, where), chip)
            except OSError:
                continue
            if chip.is_identity(answer):
                taken.add(where)
                yield chip, where
