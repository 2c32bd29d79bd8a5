"""Describes bytes that came on a port and hold no packet: another device, or another baud rate."""

from __future__ import annotations

SHOWN = 24
FEWEST = 32  # fewer may be the rest of a packet: the host begins to read anywhere
TEXT = frozenset(range(0x20, 0x7F)) | frozenset(b"\t\r\n")


class StrangeBytes:
    """Counts the bytes since the last packet, and keeps the first of them."""

    def __init__(self) -> None:
        self.count = 0
        self._first = b""

    def add(self, data: bytes) -> None:
        self._first = (self._first + data[:SHOWN])[:SHOWN]
        self.count += len(data)

    def forget(self) -> None:
        if self.count:
            self.count, self._first = 0, b""

    def sentence(self, seconds: float, baud: int) -> str | None:
        """The bytes of this time, and their likely sender; None if there are too few."""
        if self.count < FEWEST:
            return None
        return (
            f"{self.count} bytes came in {seconds:.1f} s, but no packet; they begin with {shown(self._first)}: "
            f"wrong baud (it is {baud}), or another device?"
        )


def shown(data: bytes) -> str:
    """Text as text, with escapes; anything else in hexadecimal."""
    if data and sum(byte in TEXT for byte in data) >= 0.9 * len(data):
        return repr(data)[1:]
    return data.hex(" ")
