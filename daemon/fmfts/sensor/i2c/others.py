"""Which chips answer on a bus, whatever the configuration says: so that a fault can name what is there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import chain

from fmfts.sensor.chips import CHIPS, Chip
from fmfts.sensor.chips.unread import UNREAD, UnreadChip
from fmfts.sensor.i2c.bus import ChipWires, I2cBus


def identity_of_another(chip: Chip, bus: I2cBus, address: int | None = None) -> bytes | None:
    """The identification of another kind of chip that answers on the selected channel; None if there is none.

    address: ask only there.
    """
    found = (other.identity for other, _ in chips_answering(bus, address) if not chip.is_identity(other.identity))
    unread = (other.identity for other in unread_answering(bus, address))
    return next(chain(found, unread), None)


def chips_answering(bus: I2cBus, address: int | None = None) -> Iterator[tuple[Chip, int]]:
    """The chips on the selected channel, and where each answers. Kinds with the same identification count as one.

    Asking for an identification changes nothing in any of these chips, but may end an MLX90393's measurement.
    """
    asked: set[tuple[bytes, int]] = set()
    for chip in CHIPS.values():
        for where in chip.addresses:
            if (chip.identity, where) in asked or (address is not None and where != address):
                continue
            asked.add((chip.identity, where))
            try:
                answer = chip.driver.identify(ChipWires(bus, where), chip)
            except OSError:
                continue
            if chip.is_identity(answer):
                yield chip, where


def unread_answering(bus: I2cBus, address: int | None = None) -> Iterator[UnreadChip]:
    """The chips on the selected channel that the daemon knows, and does not read. address: ask only there."""
    for chip in UNREAD.values():
        if address in (None, chip.address):
            with suppress(OSError):
                if chip.answers(ChipWires(bus, chip.address)):
                    yield chip
