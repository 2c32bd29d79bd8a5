"""Chips that the daemon does not read, but names where it finds them: so that nobody looks for a loose wire."""

from __future__ import annotations

from dataclasses import dataclass

from fmfts.sensor.chips.driver import Wires


@dataclass(frozen=True, slots=True)
class UnreadChip:
    """holds: registers, each with a mask and what it holds under it. identity: as an identification in the hello."""

    name: str
    label: str
    address: int
    holds: tuple[tuple[int, int, int], ...]
    identity: bytes
    instead: str

    def answers(self, wires: Wires) -> bool:
        """Whether this chip is there. Raises OSError where nothing answers."""
        for register, mask, value in self.holds:
            held = wires.exchange(bytes((register,)), 1)
            if held[0] & mask != value:
                return False
        return True

    @property
    def remark(self) -> str:
        return f"which this daemon does not read: {self.instead}"


# Registers as public drivers have them; its data sheet was not read. 0x80 at register 0 alone may be a potentiometer,
# which says its middle to every question: so bit 7 of control 2, the soft reset, must be zero.
QMC5883P = UnreadChip(
    name="qmc5883p",
    label="QMC5883P",
    address=0x2C,
    holds=((0x00, 0xFF, 0x80), (0x0B, 0x80, 0x00)),
    identity=b"\x80\x2c\x00",
    instead="it is sold as QMC5883L and HMC5883L, and has other registers; fit a QMC5883L or an MMC5983MA",
)

UNREAD: dict[str, UnreadChip] = {chip.name: chip for chip in (QMC5883P,)}
