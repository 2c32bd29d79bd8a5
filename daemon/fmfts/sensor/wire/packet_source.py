"""The common part of both packet sources: bytes wait for `poll`, or another reader borrows the line (see
ByteSource)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from fmfts.sensor.early import EarlySample
from fmfts.sensor.patience import Patience
from fmfts.sensor.source import AbsentError, SourceState
from fmfts.sensor.wire.clock import DeviceClock, HostClock
from fmfts.sensor.wire.framing import MAX_LINE_BYTES
from fmfts.sensor.wire.link import Link
from fmfts.sensor.wire.newest import keep_newest
from fmfts.sensor.wired_pad import WiredPad


class PacketSource:
    """The part of a ByteSource without a port or a process; `_descriptor` is set while a line is open."""

    def __init__(
        self, pads: Mapping[int, WiredPad], description: str, clock: DeviceClock | HostClock, uid: bytes | None = None
    ) -> None:
        self.state = SourceState(description=description, has_clock=isinstance(clock, DeviceClock))
        self.patience: Patience | None = None
        self._pads = pads
        self._clock = clock
        self._link = Link(pads, self.state, clock, uid)
        self._descriptor: int | None = None
        self._outbox = b""
        self._unread = b""  # packets, or the beginning of one

    def fileno(self) -> int | None:
        return self._descriptor

    @property
    def clock_line(self) -> memoryview:
        return self._clock.line

    def take_early(self) -> Sequence[tuple[int, EarlySample]]:
        early, self._link.early = self._link.early, []
        return early

    def lendable(self) -> frozenset[int]:
        if self._descriptor is None or self._outbox or not (self.state.connected and self._link.is_quiet):
            return frozenset()
        self._unread = self._link.give_back() + self._unread
        if b"\0" in self._unread or len(self._unread) > MAX_LINE_BYTES:
            return frozenset()  # a whole packet waits for `poll`, or the bytes are no packet
        return frozenset(index for index in self._pads if self._link.accepts(index))

    def lend(self) -> tuple[int, bytes]:
        assert self._descriptor is not None
        unread, self._unread = self._unread, b""
        return self._descriptor, unread

    def give_back(self, unread: bytes, heard_ns: int, left_out: Sequence[int]) -> None:
        self._unread = unread
        self.state.leave_out(left_out)
        self._link.heard_ns = max(self._link.heard_ns, heard_ns)

    def passed(self, pad_index: int, sequence: int) -> None:
        self._link.passed(pad_index, sequence)

    def request_selftest(self, pad_index: int) -> None:
        if not self.state.connected:
            where = f"pad {self._pads[pad_index].name!r}: no self-test: {self.state.description}"
            raise AbsentError(f"{where}: {self.state.reason}")
        self._link.request_selftest(pad_index, time.monotonic_ns())

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return self._link.selftest_result(pad_index)

    def _keep_newest(self) -> None:
        """Drop superseded samples from the unread bytes."""
        if self.patience is not None:
            self._unread, left_out = keep_newest(self._unread, self.patience)
            self.state.leave_out(left_out)

    def _take_unread(self) -> bytes:
        unread, self._unread = self._unread, b""
        return unread
