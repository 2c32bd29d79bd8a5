"""Registers that a report reads from each chip: those of its data sheet, and the chip goes on measuring after it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from emulated_bus import Clock, EmulatedBus, clock, emulated_pad, read, run

from emulator.chips import Bus, Hmc5983, Tca9548a
from emulator.magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p
from emulator.mlx90393 import Mlx90393
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.i2c.bus import ChipWires
from fmfts.sensor.i2c.scan import scan

__all__ = ["clock"]
KINDS: dict[str, Any] = {
    "hmc5983": Hmc5983,
    "qmc5883l": Qmc5883l,
    "qmc5883p": Qmc5883p,
    "lis3mdl": Lis3mdl,
    "mmc5983ma": Mmc5983ma,
    "mmc5603nj": Mmc5603nj,
    "mlx90393": Mlx90393,
}
# Register maps of the data sheets: Honeywell 900425 table 2, QST 13-52-04 section 9, ST DocID024204 section 6, MEMSIC
# rev. A "register map". Of the MLX90393 (Melexis 3901090393, memory map) words 0x00 to 0x1F are the customer's. The two
# chips whose sheets were not read: Adafruit_QMC5883P.h, and Linux mmc5633.c with Alif's driver of it (0x1E to 0x29).
MAPS = {
    "hmc5983": {*range(0x0D), 0x31, 0x32},
    "qmc5883l": set(range(0x0E)),
    "qmc5883p": {*range(0x07), 0x09, 0x0A, 0x0B, 0x29},
    "mmc5603nj": {*range(0x0A), 0x18, 0x19, *range(0x1A, 0x21), *range(0x27, 0x2A), 0x39},
    "lis3mdl": {*range(0x05, 0x0B), 0x0F, *range(0x20, 0x25), *range(0x27, 0x34)},
    "mmc5983ma": {*range(0x0D), 0x2F},
    "mlx90393": set(range(0x20)),
}
# Registers with known values in the same sheets: the identification; for the MLX90393 HALLCONF, the factory's 0xC.
IDENTITIES = {
    "hmc5983": (0x0A, b"H43"),
    "qmc5883l": (0x0D, b"\xff"),
    "qmc5883p": (0x00, b"\x80"),
    "lis3mdl": (0x0F, b"\x3d"),
    "mmc5603nj": (0x39, b"\x10"),
    "mmc5983ma": (0x2F, b"\x30"),
}
STATUS = {"hmc5983": 0x09, "qmc5883l": 0x06, "qmc5883p": 0x09, "lis3mdl": 0x27, "mmc5983ma": 0x08, "mmc5603nj": 0x18}
FIELD_GAUSS = (0.75, -0.5, 0.3)


def dumped(kind: str, bus: EmulatedBus, address: int) -> dict[int, bytes]:
    dump = CHIPS[kind].dump
    assert dump is not None
    return dict(dump(ChipWires(bus, address)))  # type: ignore[arg-type]


def test_every_chip_that_is_read_here_reports_its_registers() -> None:
    assert [chip.name for chip in CHIPS.values() if (chip.dump is None) != chip.streamed] == []


@pytest.mark.parametrize("kind", KINDS)
def test_dump_reads_the_map_of_the_data_sheet(clock: Clock, kind: str) -> None:
    one = KINDS[kind](clock, field_gauss=FIELD_GAUSS)
    pad, bus = emulated_pad(clock, kind, [one], rate_hz=75, muxed=False)
    run(pad, clock, 0.3, 75)
    found = dumped(kind, bus, one.address)
    width = 2 if kind == "mlx90393" else 1
    registers = {first + place for first, values in found.items() for place in range(len(values) // width)}
    assert registers == MAPS[kind]
    if kind in IDENTITIES:
        where, identity = IDENTITIES[kind]
        first = max(each for each in found if each <= where)
        assert found[first][where - first :][: len(identity)] == identity
    else:
        assert found[0][1] & 0x0F == 0x0C


@pytest.mark.parametrize("kind", STATUS)
def test_dump_reads_what_single_reads_of_each_register_read(clock: Clock, kind: str) -> None:
    """A chip whose number does not advance, or that rolls over, would give other bytes. Reading clears the status."""
    one = KINDS[kind](clock, field_gauss=FIELD_GAUSS)
    pad, bus = emulated_pad(clock, kind, [one], rate_hz=75, muxed=False)
    run(pad, clock, 0.3, 75)
    one.frozen = True
    found = dumped(kind, bus, one.address)
    values = {first + place: value for first, block in found.items() for place, value in enumerate(block)}
    values.pop(STATUS[kind])
    assert values == {number: read(one, number)[0] for number in values}
    assert len(set(values.values())) > 4


@pytest.mark.parametrize("kind", KINDS)
def test_chip_measures_on_after_its_dump(clock: Clock, kind: str) -> None:
    """A HMC5983 whose mode was read keeps its output until all six data registers were read; the MLX90393 has left its
    burst, and is set up again."""
    one = KINDS[kind](clock, field_gauss=FIELD_GAUSS)
    pad, bus = emulated_pad(clock, kind, [one], rate_hz=75, muxed=False)
    good = run(pad, clock, 0.5, 75)[-1].counts[0]
    dumped(kind, bus, one.address)
    assert not getattr(one, "locked", False)
    one.field_gauss = [-each for each in FIELD_GAUSS]
    samples = run(pad, clock, 1.0, 75)
    assert samples[-1].valid == 1
    # A film's own zero, a few mG, does not change sign with the field; an old sample would differ by twice the field.
    assert np.abs(samples[-1].counts[0] + good).max() < 0.02 * np.abs(good).max()


def test_scan_with_registers_finds_the_same_chips(clock: Clock) -> None:
    chips = [Qmc5883l(clock), Lis3mdl(clock)]
    bus = EmulatedBus(clock, Bus([Tca9548a(0x70, dict(enumerate(chips)))], [Mlx90393(clock, address=0x0F)]))
    plain, full = list(scan(bus)), list(scan(bus, registers=True))  # type: ignore[arg-type]
    assert [str(one) for one in plain] == [str(one) for one in full]
    assert not any(one.registers for one in plain)
    assert [one.registers[0].partition(":")[0] for one in full] == ["0x00", "0x00", "0x05"]


def test_scan_says_where_a_chip_stops_answering(clock: Clock) -> None:
    class Breaking(EmulatedBus):
        def exchange(self, address: int, data: bytes, count: int) -> bytes:
            if data == b"\x09":
                raise OSError(121, "Remote I/O error")
            return super().exchange(address, data, count)

    bus = Breaking(clock, Bus([], [Qmc5883l(clock)]))
    (found,) = scan(bus, registers=True)  # type: ignore[arg-type]
    assert found.registers[-1] == "then no answer: Remote I/O error"
    assert len(found.registers) == 4
