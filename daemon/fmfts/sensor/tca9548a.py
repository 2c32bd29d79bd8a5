"""The TCA9548A eight-channel I2C switch (Texas Instruments SCPS207): one control byte, one bit a channel."""

from __future__ import annotations

from collections.abc import Iterable

ADDRESSES = range(0x70, 0x78)
NO_CHANNEL = 0x00


def select(channel: int) -> int:
    """Control byte that connects one channel. It takes effect at the STOP, so the read is another transfer."""
    return 1 << channel


def select_all(channels: Iterable[int]) -> int:
    """Control byte for *writing* to several channels at once; a read would get the wired-AND of all answers."""
    return sum(1 << channel for channel in set(channels))
