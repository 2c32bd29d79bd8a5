"""A message with room for its numbers: msgspec encodes it once, C writes the numbers of each frame into it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage, PoseMessage, encode
from fmfts.pipeline.fast.compiled import NUMBERS

INTEGERS = ("seq", "t_sample_ns", "t_publish_ns", "utc_ns")
# Marks that no other part of a message contains. Integers as large as these take eight bytes, as msgpack writes them.
FIRST_INTEGER, FIRST_FLOAT = 1 << 63, 1.23456789e300


@dataclass(frozen=True, slots=True)
class Template:
    """text: the msgpack map. places: int32 offsets of the integers, then of each number in the layout; −1: null."""

    text: bytes
    places: bytes

    @classmethod
    def of(cls, message: ContactMessage, layout: Mapping[str, int] = NUMBERS) -> Template:
        """layout: names of fields in ContactMessage or PoseMessage, and how many numbers each has. None stays null."""
        marks = _Marks()
        integers = {name: FIRST_INTEGER + index for index, name in enumerate(INTEGERS)}
        pose = None
        if message.pose is not None:
            pose = msgspec.structs.replace(message.pose, **marks.replacing(message.pose, layout))
        marked = msgspec.structs.replace(message, **integers, **marks.replacing(message, layout), pose=pose)
        text = encode(marked)
        places = [text.index(struct.pack(">Q", integers[name])) for name in INTEGERS]
        for name, count in layout.items():
            found = [text.index(struct.pack(">d", mark)) for mark in marks.of.get(name, ())]
            places += found or [-1] * count
        return cls(text, np.array(places, dtype=np.int32).tobytes())


class _Marks:
    """Replaces each number of a message by a mark that occurs only once."""

    def __init__(self) -> None:
        self.of: dict[str, list[float]] = {}
        self._next = FIRST_FLOAT

    def replacing(
        self, values: ContactMessage | PoseMessage, layout: Mapping[str, int]
    ) -> dict[str, float | tuple[float, ...]]:
        named = [name for name in layout if getattr(values, name, None) is not None]
        for name in named:
            self.of[name] = [self._mark() for _ in range(layout[name])]
        return {name: self.of[name][0] if layout[name] == 1 else tuple(self.of[name]) for name in named}

    def _mark(self) -> float:
        self._next *= 1.000001
        return self._next
