"""The interface of every source of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import Frame
from fmfts.sensor.patience import Patience


class SourceError(Exception):
    """A source cannot carry out a request; the text names pad, device, cause and what to do next."""


class AbsentError(SourceError):
    """The device is not connected."""


OPENING = "it is being opened"


class LackingError(SourceError):
    """The package that reads it is not installed, or does not fit this version."""


class CannotError(SourceError):
    """The device is there, but cannot do this, or not now."""


@dataclass(slots=True)
class SourceState:
    """A source's state, which only the source writes and `status` reads. Counters only grow."""

    description: str
    connected: bool = False
    has_clock: bool = False  # a board's clock times its samples
    reason: str = OPENING
    since_ns: int = 0
    crc_errors: int = 0
    garbage_bytes: int = 0
    reconnects: int = 0
    left_out: dict[int, int] = field(default_factory=dict)  # pad index → frames superseded or overdue before any poll
    pad_faults: dict[int, str] = field(default_factory=dict)  # pad index → why nothing of this pad can be used
    sensor_faults: dict[tuple[int, int], str] = field(default_factory=dict)  # (pad index, sensor) → what is wrong
    warnings: dict[str, str] = field(default_factory=dict)  # subject → a sentence that holds now
    board: dict[str, object] = field(default_factory=dict)  # identity: uid, firmware, reset cause, chips …
    _was_connected: bool = False

    @property
    def is_opening(self) -> bool:
        """Whether it was neither connected nor found absent yet."""
        return not self.connected and not self.since_ns

    def leave_out(self, counts: Sequence[int]) -> None:
        """Count frames that were left out, by pad index."""
        for pad_index, count in enumerate(counts):
            if count:
                self.left_out[pad_index] = self.left_out.get(pad_index, 0) + count

    def follow(self, before: SourceState) -> SourceState:
        """Continue from the state of the source that this one replaces: its counters, and why it is not connected."""
        self.crc_errors += before.crc_errors
        self.garbage_bytes += before.garbage_bytes
        self.reconnects += before.reconnects
        self.left_out = dict(before.left_out)
        self._was_connected = before._was_connected
        if before.since_ns:
            self.reason, self.since_ns = before.reason, before.since_ns
        return self

    def connect(self, now_ns: int) -> None:
        if not self.connected:
            self.reconnects += self._was_connected
            self.connected, self._was_connected, self.reason, self.since_ns = True, True, "", now_ns

    def disconnect(self, reason: str, now_ns: int) -> None:
        """Mark it absent, for this reason; `since_ns` stays if it was absent before."""
        if self.connected or not self.since_ns:
            self.since_ns = now_ns
        self.connected, self.reason = False, reason


class Source(Protocol):
    """A device (or a stand-in) that feeds one or several pads. No call here ever blocks."""

    state: SourceState

    def fileno(self) -> int | None:
        """The descriptor to wait on, None while there is none (device absent, or driven by time alone)."""

    def deadline_ns(self) -> int | None:
        """CLOCK_MONOTONIC time at which `poll` wants to be called although nothing is readable; None: never."""

    def poll(self, now_ns: int) -> Sequence[Frame]:
        """The frames that are complete now. Also opens, reopens and repeats requests when they are due."""

    def request_selftest(self, pad_index: int) -> None:
        """Start a self-test; its result appears later in `selftest_result`. SourceError where it cannot."""

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        """The last self-test's facts for this pad (`selftest_facts` in chips/selftest.py), None while it runs."""

    def close(self) -> None:
        """Release the device. Idempotent."""


UNSETTLED_FRAMES = 4  # the first after hands took hold of a pad, in which a chip may still have older samples


class Hands(Protocol):
    """Hold a pad as a recording needs it."""

    def let_go(self) -> None:
        """Restores the pad, and its motion."""


@runtime_checkable
class HandledSource(Protocol):
    """A source whose pad nobody can touch, such as a simulated one: it does a person's part in a baseline itself."""

    def hands(self, *, bare: bool, turn: bool, refine: bool, weight_n: float = 0.0) -> Hands:
        """bare: take the pad off. turn, refine: as for `baseline`. weight_n: stands in its middle, if not 0."""


@runtime_checkable
class ByteSource(Source, Protocol):
    """A source whose bytes another reader may take over."""

    patience: Patience | None  # set by the daemon: which frames `poll` leaves out as superseded; None: none

    @property
    def clock_line(self) -> memoryview:
        """`DeviceClock.line` of the board's clock."""

    def take_early(self) -> Sequence[tuple[int, EarlySample]]:
        """Samples that the last `poll` found before their frames, each with the number, in what that returned, of the
        frame before which it came; each is returned once. Only of pads that are configured so."""

    def lendable(self) -> frozenset[int]:
        """Pads whose samples another reader may take now; none while there are other packets to read or to send."""

    def lend(self) -> tuple[int, bytes]:
        """The descriptor, and the beginning of an unfinished sample; until `give_back`, only the caller reads."""

    def give_back(self, unread: bytes, heard_ns: int, left_out: Sequence[int]) -> None:
        """unread: other bytes, for `poll`. heard_ns: when a sample came, 0: none came. left_out: frames that the caller
        dropped, by pad index."""

    def passed(self, pad_index: int, sequence: int) -> None:
        """The caller handled frames of this pad, and this was the number of the last one."""
