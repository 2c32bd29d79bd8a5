"""Recording a baseline: frames collected, judged, stored. The same job within the daemon and without one."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmfts import baseline as ambient
from fmfts.arithmetic.elementary import square
from fmfts.baseline import Baseline, BaselineError, Mounting
from fmfts.baseline.files import previous, store
from fmfts.pad import Pad, Tolerance
from fmfts.sensor import Frame, Source
from fmfts.sensor.tasks import PATIENCE_S

# The mean over 3 s at 220 Hz is 25 times quieter than one sample; more would mostly collect drift.
DURATION_S = 3.0
# A turn that spans space, and thirty presses, take a person so long.
TURN_S, REFINE_S = 20.0, 40.0
SHORTEST_S, LONGEST_S = 0.5, 60.0
# The device's clock says when a recording is complete, this computer's when that takes too long.
OVERTIME_S = 5.0


@dataclass(frozen=True, slots=True)
class Recorded:
    """A baseline that is stored and may be used."""

    baseline: Baseline
    mounting: Mounting
    path: Path
    gained: dict[str, float]

    def facts(self, pad: Pad) -> dict[str, Any]:
        """What a person wants to know of it."""
        return _report(self.baseline, self.mounting, pad) | self.gained | {"stored": str(self.path)}


@dataclass(frozen=True, slots=True)
class BaselineRequest:
    """bare: the pad is not mounted; else it is, and unloaded. replaced: another pad than the last time.

    turn, refine: better what was recorded at rest, by turning the robot, or by presses anywhere. duration_s: what such
    a recording takes if None. BaselineError where the duration, or the choice, makes no sense.
    """

    pad: Pad
    tolerance: Tolerance
    bare: bool
    replaced: bool
    duration_s: float | None = None
    turn: bool = False
    refine: bool = False

    def __post_init__(self) -> None:
        if self.bare + self.turn + self.refine > 1:
            raise BaselineError(f"pad '{self.pad.name}': one of bare, turn and refine at a time")
        if not SHORTEST_S <= self.seconds <= LONGEST_S:
            raise BaselineError(
                f"pad '{self.pad.name}': a baseline takes {SHORTEST_S:g} to {LONGEST_S:g} s, not {self.seconds:g} s"
            )

    @property
    def seconds(self) -> float:
        if self.duration_s is not None:
            return self.duration_s
        return TURN_S if self.turn else REFINE_S if self.refine else DURATION_S

    def make(self, frames: Sequence[Frame], before: Baseline | None) -> tuple[Baseline, Mounting]:
        """BaselineError, naming the pad, where the frames do not make one; nothing is changed then."""
        try:
            if self.turn:
                return ambient.make_turn(self.pad, ambient.means(frames), before)
            if self.refine:
                return ambient.make_refined(self.pad, ambient.means(frames), before)
            recording = ambient.summarise(frames)
            if self.bare:
                baseline = ambient.make_bare(self.pad, self.tolerance, recording, before)
                return baseline, baseline.mounting(self.pad)
            return ambient.make_rest(self.pad, self.tolerance, recording, before, self.replaced)
        except BaselineError as error:
            raise BaselineError(f"pad '{self.pad.name}': baseline refused: {error}") from error

    def record(self, frames: Sequence[Frame], before: Baseline | None) -> Recorded:
        """Make and store one. BaselineError as from `make`, StateError where it cannot be stored."""
        baseline, mounting = self.make(frames, before)
        gained: dict[str, float] = {}
        if before is not None and (self.turn or self.refine):
            was, now = (ambient.accuracy(known, self.pad) for known in (before.mounting(self.pad), mounting))
            gained = {f"{when}_{name}": facts[name] for name in now for when, facts in (("was", was), ("now", now))}
        return Recorded(baseline, mounting, store(baseline, self.pad), gained)


def restore(pad: Pad) -> Recorded:
    """Bring the baseline before the last one back; the last one, where it is good, becomes the one before.

    BaselineError where there is none, StateError where it cannot be stored.
    """
    baseline = previous(pad)
    return Recorded(baseline, baseline.mounting(pad), store(baseline, pad), {})


class Collection:
    """The frames of one pad for `duration_s` by the device's clock. now_s: time.monotonic()."""

    def __init__(self, source: Source, duration_s: float) -> None:
        self.frames: list[Frame] = []
        self._source = source
        self._duration_s = duration_s
        self._begun_s = self._heard_s = time.monotonic()
        self._went_back = False

    def take(self, frame: Frame) -> None:
        self._went_back |= bool(self.frames) and frame.device_time_us < self.frames[-1].device_time_us
        self.frames.append(frame)
        self._heard_s = time.monotonic()

    @property
    def complete(self) -> bool:
        return bool(self.frames) and not self._went_back and self._span_s >= self._duration_s

    @property
    def share(self) -> float:
        return 1.0 if self.complete else min(max(self._span_s / self._duration_s, 0.0), 1.0)

    def problem(self, now_s: float) -> str:
        """Why it will never be complete, "" while there is hope."""
        if self._went_back:
            return "the device's clock went back while recording, so it was reset: check its supply, then record again"
        if now_s - self._heard_s > PATIENCE_S:
            state = self._source.state
            return f"{state.description}: {state.reason or f'connected, but no frame within {PATIENCE_S:g} s'}"
        if now_s - self._begun_s > self._duration_s + OVERTIME_S:
            return f"in {now_s - self._begun_s:.0f} s the device's clock went on by {self._span_s:.1f} s: is it halted?"
        return ""

    @property
    def _span_s(self) -> float:
        return (self.frames[-1].device_time_us - self.frames[0].device_time_us) * 1e-6 if self.frames else 0.0


class BaselineJob:
    """A Task. Collects frames, then computes and stores elsewhere: the thread that publishes must not wait for it."""

    def __init__(self, request: BaselineRequest, before: Baseline | None, source: Source, executor: Executor) -> None:
        self._request = request
        self._before = before
        self._executor = executor
        self._collection = Collection(source, request.seconds)
        self._result: Future[Recorded] | None = None

    def take(self, frame: Frame) -> None:
        """The next frame of the pad; ignored once there are enough."""
        if self._result is not None:
            return
        self._collection.take(frame)
        if self._collection.complete:
            self._result = self._executor.submit(self._request.record, self._collection.frames, self._before)

    @property
    def share(self) -> float:
        return self._collection.share

    @property
    def recorded(self) -> Recorded | None:
        return self._result.result() if self._result is not None and self._result.done() else None

    def facts(self) -> dict[str, Any] | None:
        recorded = self.recorded
        return None if recorded is None else recorded.facts(self._request.pad)

    def problem(self, now_s: float) -> str:
        if self._result is not None:  # computing ends by itself
            return ""
        problem = self._collection.problem(now_s)
        return f"no baseline was recorded: {problem}" if problem else ""


class Restoration:
    """A Task: the same for bringing the last good baseline back."""

    share = 0.0

    def __init__(self, pad: Pad, executor: Executor) -> None:
        self._pad = pad
        self._result = executor.submit(restore, pad)

    @property
    def recorded(self) -> Recorded | None:
        return self._result.result() if self._result.done() else None

    def facts(self) -> dict[str, Any] | None:
        recorded = self.recorded
        return None if recorded is None else recorded.facts(self._pad)

    def problem(self, now_s: float) -> str:
        return ""


def _report(baseline: Baseline, mounting: Mounting, pad: Pad) -> dict[str, Any]:
    """What a person wants to know of a new baseline."""
    recording = baseline.rest or baseline.bare
    assert recording is not None
    facts: dict[str, Any] = {
        "pad": baseline.pad,
        "baseline": baseline.id,
        "kind": baseline.kind,
        "duration_s": recording.duration_s,
        "temperature_c": recording.temperature_c,
        "noise_t": float(np.sqrt(np.mean(square(np.array(recording.noise_t))))),
        "noise_per_axis_t": recording.noise_t,
    }
    if mounting.ambient_t is not None and mounting.ambient_deviation_t is not None:
        facts["ambient_t"] = mounting.ambient_t.tolist()
        facts["ambient_sd_t"] = mounting.ambient_deviation_t.tolist()
    if baseline.rest is not None:
        deviation = np.sqrt(np.diagonal(mounting.rest_covariance))
        remanence_t = mounting.remanence_t(pad)
        facts |= {
            "with_bare": baseline.bare is not None,
            "remanence_t": remanence_t,
            "remanence_sd_t": float(deviation[5]) * remanence_t,
            "rest_position_m": mounting.rest.position_m.tolist(),
            "rest_position_sd_m": deviation[:3].tolist(),
            "rest_axis": mounting.rest.axis.tolist(),
            "rest_axis_sd_rad": float(deviation[3:5].max()),
            "chi2": mounting.chi2,
            "measurements": mounting.measurements,
        }
    return facts
