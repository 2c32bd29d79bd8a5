"""A contact's message with room for its numbers: msgspec writes it once, C fills it in for every frame."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage, PoseMessage, encode
from fmfts.pipeline.fast.compiled import NUMBERS

INTEGERS = ("seq", "t_sample_ns", "t_publish_ns", "utc_ns")
# Marks that no text contains; an integer as large as these takes all of its eight bytes.
FIRST_INTEGER, FIRST_FLOAT = 1 << 63, 1.23456789e300


@dataclass(frozen=True, slots=True)
class Template:
    """text: the msgpack map. places: int32 offsets of the integers, then of every number of the layout, −1: null."""

    text: bytes
    places: bytes

    @classmethod
    def of(cls, message: ContactMessage, layout: Mapping[str, int] = NUMBERS) -> Template:
        """layout: the numbers' names in ContactMessage or PoseMessage, and how many each is; None stays null."""
        marks = _Marks()
        integers = {name: FIRST_INTEGER + index for index, name in enumerate(INTEGERS)}
        pose = None
        if message.pose is not None:
            pose = msgspec.structs.replace(message.pose, **marks.instead_of(message.pose, layout))
        marked = msgspec.structs.replace(message, **integers, **marks.instead_of(message, layout), pose=pose)
        text = encode(marked)
        places = [text.index(struct.pack(">Q", integers[name])) for name in INTEGERS]
        for name, count in layout.items():
            found = [text.index(struct.pack(">d", mark)) for mark in marks.of.get(name, ())]
            places += found or [-1] * count
        return cls(text, np.array(places, dtype=np.int32).tobytes())


class _Marks:
    """A number of its own for each number of a message."""

    def __init__(self) -> None:
        self.of: dict[str, list[float]] = {}
        self._next = FIRST_FLOAT

    def instead_of(
        self, values: ContactMessage | PoseMessage, layout: Mapping[str, int]
    ) -> dict[str, float | tuple[float, ...]]:
        named = [name for name in layout if getattr(values, name, None) is not None]
        for name in named:
            self.of[name] = [self._mark() for _ in range(layout[name])]
        return {name: self.of[name][0] if layout[name] == 1 else tuple(self.of[name]) for name in named}

    def _mark(self) -> float:
        self._next *= 1.000001
        return self._next
