"""Recording in the running daemon or in a verb: collects frames, has the baseline made and stored in another thread."""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

from fmfts.baseline.baseline import Baseline
from fmfts.baseline.files import path_of, store_gains
from fmfts.baseline.origin import Origin
from fmfts.baseline.recording import MINIMUM_FRAMES
from fmfts.baseline.request import BaselineRequest, Recorded, restore
from fmfts.pad import Pad
from fmfts.sensor import Frame, Source
from fmfts.sensor.probing import silence_of
from fmfts.sensor.tasks import PATIENCE_S, Deadline, Selftest
from fmfts.service.recorded_by import foreign

# The device's clock decides when a recording is complete; this computer's clock decides when it takes too long.
OVERTIME_S = 5.0
# A busy computer loses frames: longest extension of a recording to get enough.
EXTRA_S = 2.5
# A board that was just opened keeps its former range until the request for the configured range has arrived.
SETTLING_S = 0.5
LEAP_NS = 300_000_000


class Collection:
    """Collects the frames of one pad for `duration_s` of the device's clock, and for up to EXTRA_S more where they are
    fewer than `fewest`. now_s: time.monotonic()."""

    def __init__(self, source: Source, duration_s: float, fewest: int = 1, pad_index: int = 0) -> None:
        self.frames: list[Frame] = []
        self._source = source
        self._pad_index = pad_index
        self._duration_s = duration_s
        self._fewest = fewest
        self._begun_s: float | None = None  # since the first frame
        self._silent_too_long = Deadline(source)
        self._leapt = False
        self._least_delay_ns = 0

    def take(self, frame: Frame) -> None:
        if self.frames and frame.gain_code != self.frames[-1].gain_code and self._span_s < SETTLING_S:
            self.frames.clear()
        if self._begun_s is None:
            self._begun_s = time.monotonic()
        self._leapt |= self._leaps_at(frame)
        self.frames.append(frame)
        self._silent_too_long.heard()

    @property
    def complete(self) -> bool:
        enough_s = self._duration_s + (0.0 if len(self.frames) >= self._fewest else EXTRA_S)
        return bool(self.frames) and not self._leapt and self._span_s >= enough_s

    @property
    def share(self) -> float:
        return 1.0 if self.complete else min(max(self._span_s / self._duration_s, 0.0), 1.0)

    def problem(self, now_s: float) -> str:
        """Why the collection will not get complete; "" if it still may."""
        if self._leapt:
            return "the device's clock leapt while recording: was it reset? Check its supply, then record again"
        if self._silent_too_long.passed(now_s):
            return silence_of(self._source, self._pad_index, PATIENCE_S)
        if self._begun_s is not None and now_s - self._begun_s > self._duration_s + OVERTIME_S:
            return f"in {now_s - self._begun_s:.0f} s the device's clock went on by {self._span_s:.1f} s: is it halted?"
        return ""

    def _leaps_at(self, frame: Frame) -> bool:
        """Whether the device's clock went back, or forward by more than the time that passed here.

        A busy computer reads a frame late, but never earlier than the smallest delay."""
        delay_ns = frame.host_time_ns - 1000 * frame.device_time_us
        if not self.frames:
            self._least_delay_ns = delay_ns
        goes_back = bool(self.frames) and frame.device_time_us < self.frames[-1].device_time_us
        goes_on = delay_ns < self._least_delay_ns - LEAP_NS
        self._least_delay_ns = min(self._least_delay_ns, delay_ns)
        return goes_back or goes_on

    @property
    def _span_s(self) -> float:
        return (self.frames[-1].device_time_us - self.frames[0].device_time_us) * 1e-6 if self.frames else 0.0


class BaselineJob:
    """A Task. Collects frames, then computes and stores in another thread: the thread that publishes must not wait.

    unsettled: so many first frames are left out. pad_index: the pad's number on its source.
    """

    def __init__(
        self,
        request: BaselineRequest,
        before: Baseline | None,
        source: Source,
        executor: Executor,
        unsettled: int = 0,
        pad_index: int = 0,
    ) -> None:
        request.require_rest(before)
        self._request = request
        self._before = before
        self._source = source
        self._executor = executor
        self._unsettled = unsettled
        # Twice as many frames, because a sensor may have no new sample in some of them.
        self._collection = Collection(source, request.seconds, 2 * MINIMUM_FRAMES, pad_index)
        self._coverage = request.coverage
        self._result: Future[Recorded] | None = None
        self._stopped = False
        self._error: BaseException | None = None

    def break_off(self, error: BaseException) -> None:
        """Record nothing, because of an error: `facts` raises it."""
        self._error = error

    def stop(self) -> bool:
        """Record nothing. False: too late, a baseline is already computed from enough frames."""
        self._stopped = self._result is None
        return self._stopped

    def take(self, frame: Frame) -> None:
        """The next frame of the pad; ignored once there are enough."""
        if self._result is not None or self._stopped or self._error is not None:
            return
        if self._unsettled:
            self._unsettled -= 1
            return
        self._collection.take(frame)
        if self._coverage is not None:
            self._coverage.take(frame)
        if self._collection.complete or (self._coverage is not None and self._coverage.enough):
            request = self._request
            if request.origin is not None:  # by now the board has sent its hello
                request = replace(request, origin=request.origin.on(self._source.state.board))
            self._result = self._executor.submit(request.record, self._collection.frames, self._before)

    def joints(self, position_rad: Mapping[str, float], time_ns: int) -> None:
        """Positions of a hand's joints meanwhile, and their time on the host's clock."""
        if self._result is None:
            self._request.joints.take(position_rad, time_ns)

    @property
    def share(self) -> float:
        return self._collection.share

    @property
    def hint(self) -> str:
        if self._coverage is None:
            return ""
        return "enough: computing" if self._result is not None else self._coverage.hint

    @property
    def recorded(self) -> Recorded | None:
        return self._result.result() if self._result is not None and self._result.done() else None

    def facts(self) -> dict[str, Any] | None:
        if self._error is not None:
            raise self._error
        recorded = self.recorded
        return None if recorded is None else recorded.facts(self._request.pad)

    def problem(self, now_s: float) -> str:
        if self._result is not None:  # the computation always ends
            return ""
        problem = "it was stopped" if self._stopped else self._collection.problem(now_s)
        return f"no baseline was recorded: {problem}" if problem else ""


class Restoration:
    """A Task: brings the previous baseline back."""

    share = 0.0
    hint = ""

    def __init__(self, pad: Pad, executor: Executor, origin: Origin | None = None) -> None:
        self._pad = pad
        self._result = executor.submit(restore, pad, origin)

    @property
    def recorded(self) -> Recorded | None:
        return self._result.result() if self._result.done() else None

    def facts(self) -> dict[str, Any] | None:
        recorded = self.recorded
        return None if recorded is None else recorded.facts(self._pad)

    def problem(self, now_s: float) -> str:
        return ""


class GainTest:
    """A Task: the chips' own test. Where it passes, its gains, if it measured any, are stored for the next baseline.

    Its facts are those of the test, and `stored`, the file. StateError if it cannot be written.
    """

    hint = ""

    def __init__(self, pad: Pad, source: Source, pad_index: int, executor: Executor, origin: Origin | None) -> None:
        self._pad = pad
        self._origin = origin
        self._source = source
        self._executor = executor
        self._test = Selftest(pad.name, source, pad_index)
        self._result: Future[dict[str, Any]] | None = None

    @property
    def share(self) -> float:
        return self._test.share

    def facts(self) -> dict[str, Any] | None:
        if self._result is not None:
            return self._result.result() if self._result.done() else None
        facts = self._test.facts()
        if facts is None or not facts["passed"] or facts["gain_factor_sd"] is None:
            return facts
        self._result = self._executor.submit(self._store, facts)
        return None

    def _store(self, facts: dict[str, Any]) -> dict[str, Any]:
        origin = None if self._origin is None else self._origin.on(self._source.state.board)
        warnings = foreign(path_of(self._pad.name, "selftest"), "self-test")
        return facts | {"warnings": warnings, "stored": str(store_gains(facts, self._pad, origin))}

    def problem(self, now_s: float) -> str:
        return "" if self._result is not None else self._test.problem(now_s)
