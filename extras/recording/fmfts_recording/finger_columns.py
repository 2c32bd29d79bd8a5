"""The fingers on a pad in a fixed number of columns, for plots: a finger's place in the list may change."""

from __future__ import annotations

from typing import Any

import msgspec

from fmfts.bus.messages import FingerMessage
from fmfts_recording.foxglove import Time

COLUMNS = ("first", "second")


class Fingers(msgspec.Struct, frozen=True, kw_only=True):
    """The fingers of a ContactMessage. count: how many there are, of which two have a place here.

    Each stays `first` or `second` while it touches; one that does not touch is left out.
    """

    timestamp: Time
    frame_id: str
    count: int
    more: bool
    first: FingerMessage | None
    second: FingerMessage | None


class FingerColumns:
    """Gives each finger a column, and keeps it there."""

    def __init__(self) -> None:
        self._ids: dict[str, int] = {}  # ids of the fingers in a column

    def fingers(self, time: Time, pad: str, contacts: list[dict[str, Any]], more: bool) -> Fingers:
        """contacts: as in the message."""
        touching = {each["id"]: each for each in contacts}
        self._ids = {column: number for column, number in self._ids.items() if number in touching}
        free = [column for column in COLUMNS if column not in self._ids]
        new = [number for number in touching if number not in self._ids.values()]
        self._ids |= dict(zip(free, new, strict=False))
        columns = {
            column: msgspec.convert(touching[self._ids[column]], FingerMessage) if column in self._ids else None
            for column in COLUMNS
        }
        return Fingers(timestamp=time, frame_id=pad, count=len(contacts), more=more, **columns)
