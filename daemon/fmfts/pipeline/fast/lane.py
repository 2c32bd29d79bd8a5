"""A pad's lane: C handles its frames from the board's bytes to the bus, as long as they are healthy."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from fmfts.pipeline.fast import _fast
from fmfts.pipeline.fast.template import Template


class Kind(IntEnum):
    """The kind of a healthy frame's message: fmfts_kind in tables.h."""

    QUIET = 0
    TOUCHED = 1
    OVER_RANGE = 2


KINDS = tuple(Kind)


class Passed(NamedTuple):
    """What C published since a lane was begun: `frames`, and samples that came before theirs.

    first_sequence, sequence: of the first and the last frame; without any, of the one before. number, kind, payload,
    t_sample_ns, t_publish_ns: of the last message. arrival_ns: of the last frame. frame_us, frame_ns: the last frame's
    time on the board's clock, and on the host's. latencies_s: sample → publish, of each frame. changes: the messages
    whose kind differs from the one before.
    """

    frames: int
    first_sequence: int
    sequence: int
    number: int
    kind_number: int
    payload: bytes
    changes: tuple[bytes, ...]
    arrival_ns: int
    t_sample_ns: int
    t_publish_ns: int
    frame_us: int
    frame_ns: int
    latencies_s: list[float]

    @property
    def kind(self) -> Kind:
        return KINDS[self.kind_number]


class Lane:
    """Lets C handle a pad's frames while they are healthy: lane.h."""

    def __init__(self, compiled: _fast.Lane) -> None:
        self.compiled = compiled

    def begin(
        self,
        templates: Sequence[Template],
        kind: Kind,
        number: int,
        sequence: int,
        t_sample_ns: int,
        frame_times: tuple[int, int],
    ) -> None:
        """Let C handle frames until end(). templates: one for each Kind. The others: of the last message; frame_times:
        its frame's time on the board's clock (µs), and on the host's (ns)."""
        quiet, touched, over_range = [(template.text, template.places) for template in templates]
        times = t_sample_ns, *frame_times
        self.compiled.begin((quiet, touched, over_range), kind, number, sequence % 2**32, *times)

    def last_ns(self) -> int:
        """When the last frame since begin() arrived (host clock, ns); 0 if there was none."""
        return self.compiled.last_ns()

    def end(self) -> Passed | None:
        """Stop, and return what C handled since begin(); None if it made no message."""
        passed = self.compiled.end()
        return None if passed is None else Passed(*passed)
