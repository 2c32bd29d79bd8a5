"""The TCA9548A eight-channel I2C switch (Texas Instruments SCPS207): one control byte, one bit a channel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

NO_CHANNEL = 0x00
CHANNELS = 8
ADDRESSES = range(0x70, 0x78)  # pins A0 to A2


class ByteBus(Protocol):
    def write(self, address: int, data: bytes) -> None: ...

    def read(self, address: int, size: int) -> bytes: ...


def one(channel: int) -> int:
    """Control byte that connects one channel."""
    return 1 << channel


def several(channels: Iterable[int]) -> int:
    """Control byte for *writing* to several channels at once; a read would get the wired-AND of all answers."""
    return sum(1 << channel for channel in set(channels))


class Switches:
    """All muxes of one bus; while one has a channel open, the others have none. Errors are the bus's OSError.

    A selection takes effect at its STOP, which is why it is a transfer of its own.
    """

    def __init__(self, bus: ByteBus, addresses: Iterable[int]) -> None:
        self._bus = bus
        self._control: dict[int, int | None] = dict.fromkeys(addresses)  # None: unknown

    def select(self, address: int | None, control: int) -> None:
        """Connect only the channels in `control` of the mux at `address`. None: disconnect all muxes."""
        for other, active in self._control.items():
            if other != address and active != NO_CHANNEL:
                self._write(other, NO_CHANNEL)
        if address is not None and self._control[address] != control:
            self._write(address, control)

    def foreign_control(self, address: int) -> int | None:
        """The control byte, if it is not the one written last, because another program uses this mux. It is unknown
        then."""
        actual = self._bus.read(address, 1)[0]
        if actual == self._control[address]:
            return None
        self.forget()
        return actual

    def forget(self) -> None:
        """The next selection is written in any case."""
        self._control = dict.fromkeys(self._control)

    def _write(self, address: int, control: int) -> None:
        self._control[address] = None  # unknown until the write succeeded
        self._bus.write(address, bytes((control,)))
        self._control[address] = control
