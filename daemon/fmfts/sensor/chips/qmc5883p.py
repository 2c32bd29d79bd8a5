"""The QMC5883P three-axis magnetometer: facts and registers (Adafruit_QMC5883P, ArduPilot, reznikmm/qmc5883p).

Boards named GY-271, HMC5883L or QMC5883L carry it today. Address, registers and scale are its own.
"""

from __future__ import annotations

from dataclasses import replace
from struct import Struct

from fmfts.sensor.chips.chip import Axes, Chip
from fmfts.sensor.chips.driver import Setup, Wires, overflowing, registers, transfer_bits
from fmfts.sensor.chips.qmc5883l import QMC5883L

IDENTIFICATION, AXES, STATUS, CONTROL_1, SIGNS = 0x00, 0x01, 0x09, 0x0A, 0x29
STATUS_READY, STATUS_OVERFLOW = 0x01, 0x02
MODE_NORMAL = 0x01  # control 1: mode in bits 1–0, rate in 3–2, oversampling in 5–4 (0: 8 times), downsampling in 7–6
SIGNS_OF_AXES = 0x06  # "define the sign for x, y and z": the first step of each example in its data sheet
WIDEST_RANGE = 3  # a gain code; the chip's range code in bits 3–2 of control 2 counts from the widest
_AXES = Struct("<hhh")
_TO_STATUS, _TO_AXES = bytes((STATUS,)), bytes((AXES,))


class _Registers:
    """The chip's registers for `Driver`."""

    sample_bits = 2 * transfer_bits(1, 1) + transfer_bits(1, 6)
    trigger_bits = 0
    trigger = b""  # the duration of its single measurements is in no source
    stale_samples = 1

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        """Reads both controls, too: a potentiometer at this address answers 0x80 to any request."""
        return wires.exchange(bytes((IDENTIFICATION,)), 1) + wires.exchange(bytes((CONTROL_1,)), 2)

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        control_1, control_2 = _configuration(chip, setup)
        wires.write(bytes((SIGNS, SIGNS_OF_AXES)))
        wires.write(bytes((CONTROL_1 + 1, control_2)))
        wires.write(bytes((CONTROL_1, control_1)))  # last: the mode, which begins to measure
        return self.is_set_up(wires, chip, setup)

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        return wires.exchange(bytes((CONTROL_1,)), 2) == _configuration(chip, setup)

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        """Reads the status again after the axes, so that a sample that ended in between is read once.

        This is right whether reading the status (data sheet, reznikmm) or the axes clears "ready".
        """
        block = None
        for _ in range(2):
            status = wires.exchange(_TO_STATUS, 1)[0]
            if not status & STATUS_READY:
                break
            block = bytes((status & STATUS_OVERFLOW,)) + wires.exchange(_TO_AXES, 6)
        return block is not None, block

    def axes(self, chip: Chip, block: bytes) -> Axes:
        return overflowing(chip, _AXES.unpack(block[1:]), bool(block[0]))

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        return None


QMC5883P = replace(
    QMC5883L,  # rates, noise and drift with temperature are assumed to be alike (unverified)
    name="qmc5883p",
    label="QMC5883P",
    driver=_Registers(),
    address=0x2C,
    identity=b"\x80\x00\x00",
    identity_mask=b"\xff\x00\x80",  # bit 7 of control 2, the reset, clears itself
    ranges_gauss=(2.0, 8.0, 12.0, 30.0),
    counts_per_gauss=tuple((counts, counts, counts) for counts in (15000, 3750, 2500, 1000)),
    largest_count=30000,  # beyond its range it reports an overflow, and still farther out it stays at 32767 or −32768
    dump=registers((0x00, 1), (0x01, 6), (0x09, 1), (0x0A, 2), (0x29, 1)),
    supply="made; on boards sold as HMC5883L, QMC5883L and GY-271, 2 to 6 € each",
)


def _configuration(chip: Chip, setup: Setup) -> bytes:
    """The wanted content of controls 1 and 2. Set and reset stay on: bits 1–0 of control 2 are 0."""
    rate = chip.output_rates_hz.index(chip.output_rate_hz(setup.rate_hz))
    return bytes((rate << 2 | MODE_NORMAL, WIDEST_RANGE - setup.gain_code << 2))
