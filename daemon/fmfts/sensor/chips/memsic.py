"""The registers of MEMSIC's chips with a film: MMC5983MA and MMC5603NJ. Only their numbers differ.

They are always triggered. Their streams are not used: no source says whether a stream announces a new measurement, and
with automatic set and reset each measurement takes twice its time and 1 ms.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from fmfts.sensor.chips.chip import Axes, Chip
from fmfts.sensor.chips.driver import Setup, Wires, saturating, transfer_bits

MEASURE_FIELD, SET_PULSE, RESET_PULSE = 0x01, 0x08, 0x10  # control 0; these bits clear themselves
RESET = 0x80  # control 1; the bandwidth in bits 1–0
BANDWIDTH = 2  # a measurement takes 2 ms
# A measurement needs a pause after a pulse. The maker's sample code waits 0.5 ms, ArduPilot and the MMC5603NJ's sheet
# (t_SR) 1 ms.
PULSE_PAUSE_S = 1e-3
_ZERO = 0x8000


@dataclass(frozen=True, slots=True)
class Memsic:
    """A `Driver`. Register numbers: status, control_0, product; control 1 follows control 0.

    done: the status bit that a measurement's command clears, and its end sets. fuses_read: the bit of a chip that has
    started. reset_s: what a reset takes.
    """

    status: int
    done: int
    fuses_read: int
    control_0: int
    product: int
    reset_s: float

    stale_samples = 0
    trigger_bits = transfer_bits(2)
    sample_bits = transfer_bits(1, 1) + transfer_bits(1, 6)

    @property
    def trigger(self) -> bytes:
        return bytes((self.control_0, MEASURE_FIELD))

    @property
    def set_pulse(self) -> bytes:
        return bytes((self.control_0, SET_PULSE))

    @property
    def to_status(self) -> bytes:
        return bytes((self.status,))

    def identify(self, wires: Wires, chip: Chip) -> bytes:
        return wires.exchange(bytes((self.product,)), 1) + b"\x00\x00"

    def set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """A reset does not change the film, which may be reversed, so that each axis has the wrong sign. So it is
        set."""
        wires.write(bytes((self.control_0 + 1, RESET)))
        time.sleep(self.reset_s)
        wires.write(bytes((self.control_0 + 1, BANDWIDTH)))
        wires.write(self.set_pulse)
        time.sleep(PULSE_PAUSE_S)
        return self.is_set_up(wires, chip, setup)

    def is_set_up(self, wires: Wires, chip: Chip, setup: Setup) -> bool:
        """Checks only that it has started: controls cannot be read back. A chip that was reset measures for 8 ms, or
        not at all: `I2cPad` sees that a measurement is late."""
        return bool(wires.exchange(self.to_status, 1)[0] & self.fuses_read)

    def sample(self, wires: Wires) -> tuple[bool, bytes | None]:
        """Until its end the registers hold the measurement before: read only announced ones."""
        if not wires.exchange(self.to_status, 1)[0] & self.done:
            return False, None
        return True, wires.exchange(b"\x00", 6)

    def axes(self, chip: Chip, block: bytes) -> Axes:
        """The upper 16 bits of each axis, high byte first; zero field is in the middle."""
        x, y, z = (int.from_bytes(block[each : each + 2], "big") - _ZERO for each in (0, 2, 4))
        return saturating(chip, (x, y, z))

    def temperature_count(self, wires: Wires, block: bytes) -> int | None:
        return None
