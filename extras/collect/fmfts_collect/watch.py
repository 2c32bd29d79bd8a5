"""Receives frames and forces while the pad is pressed, and stops the pressing if something is wrong. Never blocks."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile

from fmfts.cli.feed import Feed
from fmfts.sensor import Frame
from fmfts_collect.clock import Clock, Monotonic
from fmfts_collect.errors import AbsentError, CollectError, RefusedError, StoppedError
from fmfts_collect.gauge import Gauge, Reading
from fmfts_collect.settings import LONGEST_SILENCE_MS

TURN_S = 0.001
KEPT_S = 30.0
LISTEN_S = 1.0  # shortest time to measure a gauge's rate
LEAST_READINGS = 2  # fewest readings within the time of a silence, because one may be lost
FIRST_S = 3.0  # a board reports within a second after it is opened
# If this process did not run for this long, old data may wait unread, so silence is not judged in that turn.
SLEPT_S = 0.02


@dataclass(frozen=True, slots=True)
class Limits:
    """force_n: largest force; None where a person presses. silence_s: longest silence of the board and of the gauge."""

    force_n: float | None
    silence_s: float


class Watch:
    """Receives frames and forces. While `on_guard`, because the rod is down, it raises StoppedError where one of the
    limits is exceeded, frames are lost, or a device has gone."""

    def __init__(self, feed: Feed, gauge: Gauge | None, limits: Limits, clock: Clock | None = None) -> None:
        self.frames: deque[Frame] = deque()
        self.readings: deque[Reading] = deque()  # readings of the gauge, without subtracting tare_n
        self.tare_n = 0.0
        self.on_guard = False
        self.heartbeat: Callable[[], None] = lambda: None  # called at each turn
        self.clock = clock or Monotonic()
        self._feed = feed
        self._gauge = gauge
        self._limits = limits
        self._last_frame_s = self._last_force_s = self._last_turn_s = self._now_s()
        self._sequence: int | None = None

    def turn(self, *, moving: bool = False) -> None:
        """Receive what has arrived. Raises StoppedError where `on_guard`, AbsentError where a device has gone.

        moving: the machine moves outside a press: check force and silence too, but not lost frames, which spoil no row.
        """
        self.heartbeat()
        now_ns = self.clock.now_ns()
        now_s = now_ns * 1e-9
        slept = now_s - self._last_turn_s > SLEPT_S
        self._last_turn_s = now_s
        lost = self._take_frames(now_ns)
        self._take_readings(now_ns)
        self._forget(now_s)
        if self.on_guard or moving:
            self._judge(lost if self.on_guard else "", now_s, slept)

    def wait(self, seconds: float) -> None:
        """Receive for this long."""
        self.until(lambda: False, seconds)

    def until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Receive until `done`, at most for this long; returns whether it was done."""
        end_s = self._now_s() + seconds
        while True:
            self.turn()
            if done():
                return True
            if self._now_s() >= end_s:
                return False
            self.clock.sleep(TURN_S)

    def begin(self) -> None:
        """Wait for the first frame and the first force. Raises AbsentError where one does not come."""
        if not self.until(lambda: bool(self.frames), FIRST_S):
            raise AbsentError(f"no frame from {self._feed.description} within {FIRST_S:g} s: see fmfts-daemon probe")
        if self._gauge is not None and not self.until(lambda: bool(self.readings), FIRST_S):
            raise AbsentError(
                f"no force from {self._gauge.description} within {FIRST_S:g} s: is it on, are baud and pattern right?"
                + self._unread()
            )
        if self._gauge is not None and self._limits.force_n is not None:
            self._require_often(self._gauge)

    def _require_often(self, gauge: Gauge) -> None:
        """Raises RefusedError where readings arrive so rarely, or so many at once, that the gauge seems silent."""
        silence_s = self._limits.silence_s
        listen_s = max(LISTEN_S, 5 * silence_s)
        arrivals_s = {self._last_force_s}

        def count() -> bool:
            arrivals_s.add(self._last_force_s)
            return False

        self.until(count, listen_s)
        rate_hz, needed_hz = (len(arrivals_s) - 1) / listen_s, LEAST_READINGS / silence_s
        if rate_hz + 1.0 / listen_s < needed_hz:
            slower_ms = LEAST_READINGS / rate_hz * 1e3 if rate_hz else math.inf
            longer = f", or collect.silence_ms to {slower_ms:.0f}: if the gauge dies, the rod stays down for that long"
            raise RefusedError(
                f"{gauge.description} sends {rate_hz:.1f} times a second, and collect.silence_ms = "
                f"{silence_s * 1e3:g} needs {needed_hz:g}: set the gauge to a higher rate"
                f"{longer if slower_ms <= LONGEST_SILENCE_MS else ''}"
            )

    def _unread(self) -> str:
        unread = "" if self._gauge is None else self._gauge.unread
        return f"; {unread}" if unread else ""

    def forces_since(self, since_ns: int) -> list[float]:
        """The forces since that time, in their order, without tare_n subtracted."""
        newest = takewhile(lambda reading: reading.time_ns >= since_ns, reversed(self.readings))
        return [reading.force_n for reading in newest][::-1]

    def newest_force_n(self) -> float | None:
        return self.readings[-1].force_n - self.tare_n if self.readings else None

    def window(self, begun_ns: int, ended_ns: int) -> tuple[list[Frame], list[Reading]]:
        """The frames and readings from begun_ns to before ended_ns."""
        return (
            [frame for frame in self.frames if begun_ns <= frame.host_time_ns < ended_ns],
            [reading for reading in self.readings if begun_ns <= reading.time_ns < ended_ns],
        )

    def _now_s(self) -> float:
        return self.clock.now_ns() * 1e-9

    def _take_frames(self, now_ns: int) -> str:
        """Receives frames; returns a sentence about lost ones, "" where none were."""
        lost = ""
        for frame in self._feed.poll(now_ns):
            if self._sequence is not None and frame.sequence != self._sequence + 1:
                missing = frame.sequence - self._sequence - 1
                lost = f"{missing} frames were lost" if missing > 0 else "the board was reset"
            self._sequence = frame.sequence
            self.frames.append(frame)
            self._last_frame_s = now_ns * 1e-9
        return lost

    def _take_readings(self, now_ns: int) -> None:
        if self._gauge is None:
            return
        try:
            readings = self._gauge.poll(now_ns)
        except CollectError as error:
            if self.on_guard:
                raise StoppedError(str(error)) from error
            raise
        if readings:
            self.readings.extend(readings)
            self._last_force_s = now_ns * 1e-9

    def _judge(self, lost: str, now_s: float, slept: bool) -> None:
        if lost:
            raise StoppedError(f"{lost}: check the line of {self._feed.description}")
        newest_n, limit_n = self.newest_force_n(), self._limits.force_n
        if newest_n is not None and limit_n is not None and abs(newest_n) > limit_n:
            raise StoppedError(f"over-force: {newest_n:.3f} N, and collect.stage.force_limit_n is {limit_n:g} N")
        if slept:
            return
        limit_ms = self._limits.silence_s * 1e3
        silent_ms = (now_s - self._last_frame_s) * 1e3
        if silent_ms > limit_ms:
            raise StoppedError(f"no frame for {silent_ms:.0f} ms (limit {limit_ms:.0f} ms): see fmfts-daemon probe")
        silent_ms = (now_s - self._last_force_s) * 1e3
        if self._gauge is not None and silent_ms > limit_ms:
            raise StoppedError(
                f"the gauge is silent for {silent_ms:.0f} ms (limit {limit_ms:.0f} ms): check its plug and supply"
                + self._unread()
            )

    def _forget(self, now_s: float) -> None:
        oldest_ns = round((now_s - KEPT_S) * 1e9)
        while self.frames and self.frames[0].host_time_ns < oldest_ns:
            self.frames.popleft()
        while self.readings and self.readings[0].time_ns < oldest_ns:
            self.readings.popleft()
