"""A message with room for its numbers: msgspec encodes it once, C writes the numbers of each frame into it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from fmfts.bus.encoding import encode
from fmfts.bus.messages import ContactMessage, NowMessage, PoseMessage
from fmfts.pipeline.fast._fast import NUMBERS

INTEGERS = ("seq", "t_sample_ns", "t_publish_ns", "utc_ns", "now_t_ns")
OF_NOW = "now_"  # before the names of numbers in the message's map `now`
# Marks that no other part of a message contains. Integers as large as these take eight bytes, as msgpack writes them.
FIRST_INTEGER, FIRST_FLOAT = 1 << 63, 1.23456789e300


@dataclass(frozen=True, slots=True)
class Template:
    """text: the msgpack map. places: int32 offsets of the integers, then of each number in the layout; −1: null."""

    text: bytes
    places: bytes

    @classmethod
    def of(cls, message: ContactMessage, layout: Mapping[str, int] = NUMBERS) -> Template:
        """layout: names of fields in ContactMessage, PoseMessage or (after "now_") NowMessage, and how many numbers
        each has. None stays null."""
        marks = _Marks()
        integers = {name: FIRST_INTEGER + index for index, name in enumerate(INTEGERS)}
        now_ns = integers.pop("now_t_ns")
        pose, now = None, None
        if message.pose is not None:
            pose = msgspec.structs.replace(message.pose, **marks.replacing(message.pose, layout))
        if message.now is not None:
            of_now = {name.removeprefix(OF_NOW): count for name, count in layout.items() if name.startswith(OF_NOW)}
            now = msgspec.structs.replace(message.now, t_ns=now_ns, **marks.replacing(message.now, of_now, OF_NOW))
        marked = msgspec.structs.replace(message, **integers, **marks.replacing(message, layout), pose=pose, now=now)
        text = encode(marked)
        places = [text.index(struct.pack(">Q", integers[name])) for name in INTEGERS[:-1]]
        places.append(-1 if now is None else text.index(struct.pack(">Q", now_ns)))
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
        self, values: ContactMessage | PoseMessage | NowMessage, layout: Mapping[str, int], prefix: str = ""
    ) -> dict[str, float | tuple[float, ...]]:
        named = [name for name in layout if getattr(values, name, None) is not None]
        for name in named:
            self.of[prefix + name] = [self._mark() for _ in range(layout[name])]
        marks = {name: self.of[prefix + name] for name in named}
        return {name: of[0] if layout[name] == 1 else tuple(of) for name, of in marks.items()}

    def _mark(self) -> float:
        self._next *= 1.000001
        return self._next
