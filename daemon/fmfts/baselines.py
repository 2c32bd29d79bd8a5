"""Recording a baseline: frames collected, judged, stored. The same job within the daemon and without one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmfts import ambient
from fmfts.ambient import Baseline, BaselineError, Mounting
from fmfts.pad import Pad, Tolerance
from fmfts.sensor import Frame
from fmfts.service.state import state_directory, write_atomically

# The mean over 3 s at 220 Hz is 25 times quieter than one sample; more would mostly collect drift.
DURATION_S = 3.0


def path_of(pad_name: str) -> Path:
    return state_directory() / "baseline" / f"{pad_name}.json"


@dataclass(frozen=True, slots=True)
class BaselineRequest:
    """kind "bare": the pad is not mounted; "rest": it is, unloaded; replaced: another pad than the last time."""

    pad: Pad
    tolerance: Tolerance
    bare: bool
    replaced: bool

    def make(self, frames: Sequence[Frame], before: Baseline | None) -> tuple[Baseline, Mounting]:
        """BaselineError, naming the pad, where the frames do not make one; nothing is changed then."""
        try:
            recording = ambient.summarise(frames)
            if self.bare:
                baseline = ambient.make_bare(self.pad, self.tolerance, recording)
                return baseline, baseline.mounting(self.pad)
            return ambient.make_rest(self.pad, self.tolerance, recording, before, self.replaced)
        except BaselineError as error:
            raise BaselineError(f"pad '{self.pad.name}': baseline refused: {error}") from error


def store(baseline: Baseline) -> Path:
    """Write it where the daemon looks for it at its start; the one before stays beside it as `….previous.json`."""
    path = path_of(baseline.pad)
    path.parent.mkdir(exist_ok=True)
    if path.exists():
        write_atomically(path.with_suffix(".previous.json"), path.read_bytes())
    write_atomically(path, ambient.encode(baseline))
    return path


def report(baseline: Baseline, mounting: Mounting, pad: Pad) -> dict[str, object]:
    """What a person wants to know of a new baseline."""
    recording = baseline.rest or baseline.bare
    assert recording is not None
    facts: dict[str, object] = {
        "pad": baseline.pad,
        "baseline": baseline.id,
        "kind": baseline.kind,
        "duration_s": recording.duration_s,
        "temperature_c": recording.temperature_c,
        "noise_t": float(np.sqrt(np.mean(np.array(recording.noise_t) ** 2))),
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


class BaselineJob:
    """Collects frames, then computes elsewhere: the thread that publishes must not wait for it."""

    def __init__(
        self,
        request: BaselineRequest,
        before: Baseline | None,
        duration_s: float,
        executor: Executor,
        progress: Callable[[float], None],
    ) -> None:
        """progress: called with the share that is collected, now and then."""
        self._request = request
        self._before = before
        self._duration_us = duration_s * 1e6
        self._executor = executor
        self._progress = progress
        self._frames: list[Frame] = []
        self._told = 0.0
        self.result: Future[tuple[Baseline, Mounting]] | None = None

    def take(self, frame: Frame) -> None:
        """The next frame of the pad; ignored once there are enough."""
        if self.result is not None:
            return
        self._frames.append(frame)
        share = (frame.device_time_us - self._frames[0].device_time_us) / self._duration_us
        if share >= 1.0:
            self.result = self._executor.submit(self._request.make, self._frames, self._before)
        elif share >= self._told + 0.1:
            self._told = share
            self._progress(share)
