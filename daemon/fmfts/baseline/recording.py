"""Mean field and noise of every axis from a few seconds of an untouched pad; refuses unusable recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, root_of_squares
from fmfts.baseline.alternating import alternation
from fmfts.sensor.frame import Frame, fields_of
from fmfts.sensor.missing import saturated, untellable

Array = NDArray[np.float64]

MINIMUM_FRAMES = 50
FEW_FRAMES = "is the pad streaming, the computer busy?"
# A working chip gives most frames a new sample, even if its clock is slower than the frames.
STOPPED_SHARE = 0.5
MINIMUM_SHARE_VALID = 0.95
BLOCKS = 8
# With white noise, block means differ from the mean by less than so many deviations (of 96 means, once in 1e5 times).
STEADY_DEVIATIONS = 6.0
# A smaller drift (0.5 mG) is no reason to refuse: it moves the pose by a quarter of its own deviation.
STEADY_FIELD_T = 5e-8


class BaselineError(Exception):
    """A baseline cannot be recorded, stored or used; the text says why, with the figure, and what to do."""


class ForeignError(BaselineError):
    """A baseline was recorded with other sensors: on another board, or in a simulation."""


class GeometryError(BaselineError):
    """A whole baseline of this pad was recorded with another drawing of it."""


@contextmanager
def solvable(otherwise: str) -> Iterator[None]:
    """Turns SingularError and ValueError into BaselineError: numbers far from any pad's may have no solution.
    otherwise: the text, with the fault and what to do.


    """
    try:
        yield
    except (SingularError, ValueError) as error:
        raise BaselineError(f"{otherwise} ({error})") from error


@dataclass(frozen=True, slots=True)
class Recording:
    """mean_t, noise_t: (N, 3) in each sensor's own axes; noise is the standard deviation of one sample.

    samples: (N,) number of fresh samples in each mean. temperature_c: mean, None if the source has no thermometer.
    """

    mean_t: Array
    noise_t: Array
    samples: NDArray[np.int64]
    gain_code: int
    temperature_c: float | None
    duration_s: float

    @property
    def mean_deviation_t(self) -> Array:
        """(N, 3) standard deviation of the mean."""
        return self.noise_t / np.sqrt(self.samples)[:, None]


def summarise(frames: Sequence[Frame]) -> Recording:
    """The recording from these frames; BaselineError if they are too few, incomplete, saturated or moving."""
    if len(frames) < MINIMUM_FRAMES:
        raise BaselineError(f"only {len(frames)} frames arrived of at least {MINIMUM_FRAMES}: {FEW_FRAMES}")
    gain_codes = {frame.gain_code for frame in frames}
    if len(gain_codes) > 1:
        raise BaselineError("the range was changed during the recording: record again")
    valid = np.array([frame.valid for frame in frames])
    answers = valid.sum(axis=0)
    if (answers < MINIMUM_SHARE_VALID * len(frames)).any():
        raise BaselineError(_silent(frames, answers))
    overflow: NDArray[np.bool_] = np.asarray(np.array([frame.overflow for frame in frames]).any(axis=0), dtype=np.bool_)
    chip, gain_code = frames[0].chip, frames[0].gain_code
    _require(
        np.asarray(~overflow.any(axis=1), dtype=np.bool_),
        lambda sensor: f"sensor {sensor + 1} is {saturated(chip, gain_code, overflow[sensor])}",
    )
    impossible: NDArray[np.bool_] = np.asarray(np.array([frame.impossible for frame in frames]).any(axis=0), np.bool_)
    _require(
        np.asarray(~impossible.any(axis=1), dtype=np.bool_),
        lambda sensor: f"sensor {sensor + 1} is {untellable(chip, impossible[sensor])}",
    )
    fresh = np.array([frame.fresh & frame.valid for frame in frames])
    fields = fields_of(frames)
    mean, noise, wander = np.empty(fields.shape[1:]), np.empty(fields.shape[1:]), np.empty(fields.shape[1:])
    step_t = frames[0].chip.coarseness_t(frames[0].gain_code)
    for sensor in range(fields.shape[1]):
        samples = fields[fresh[:, sensor], sensor]
        if len(samples) < MINIMUM_FRAMES:
            raise BaselineError(
                f"sensor {sensor + 1} gave only {len(samples)} new samples in {len(frames)} frames: "
                + ("its clock has stopped" if len(samples) < STOPPED_SHARE * len(frames) else FEW_FRAMES)
            )
        mean[sensor] = samples.mean(axis=0)
        # Differences of successive samples show the noise without a drift. Rounding to counts sets its lower limit.
        noise[sensor] = np.maximum(np.diff(samples, axis=0).std(axis=0) / np.sqrt(2.0), step_t / np.sqrt(12.0))
        blocks = np.array([block.mean(axis=0) for block in np.array_split(samples, BLOCKS)])
        wander[sensor] = np.abs(blocks - mean[sensor]).max(axis=0)
        limit = STEADY_DEVIATIONS * noise[sensor] / np.sqrt(len(samples) / BLOCKS) + STEADY_FIELD_T
        if (wander[sensor] > limit).any():
            axis = int(np.argmax(wander[sensor] / limit))
            raise BaselineError(
                f"the field moves: sensor {sensor + 1}, axis {'xyz'[axis]} wandered by "
                f"{wander[sensor, axis] * 1e6:.2f} µT (steady is below {limit[axis] * 1e6:.2f} µT): "
                "leave pad and robot still, and record again"
            )
    alternating = alternation(frames)
    if alternating is not None:
        # Differences of successive samples show too little of slow changes.
        noise = root_of_squares(np.maximum(noise, _scatter(fields, fresh)), alternating.together_t)
    temperatures = [frame.temperature_c for frame in frames if frame.temperature_c is not None]
    return Recording(
        mean_t=mean,
        noise_t=noise,
        samples=fresh.sum(axis=0),
        gain_code=frames[0].gain_code,
        temperature_c=float(np.mean(temperatures)) if temperatures else None,
        duration_s=(frames[-1].device_time_us - frames[0].device_time_us) * 1e-6,
    )


def _scatter(fields: Array, fresh: NDArray[np.bool_]) -> Array:
    """(N, 3) standard deviation of the samples about their mean."""
    return np.array([fields[fresh[:, sensor], sensor].std(axis=0) for sensor in range(fields.shape[1])])


def _silent(frames: Sequence[Frame], answers: NDArray[np.int64]) -> str:
    """Which sensors stopped answering, and when. answers (N,): in how many frames each one answered."""
    since_s = [
        next((_seconds_between(frames[0], after) for after in _silent_at_the_end(frames, sensor)), None)
        for sensor in range(len(answers))
    ]
    if (answers < MINIMUM_SHARE_VALID * len(frames)).all():
        text = f"all {len(answers)} sensors answered in at most {answers.max()} of {len(frames)} frames"
        ended = [moment for moment in since_s if moment is not None]
        if len(ended) == len(since_s):
            text += f", and in none after {max(ended):.2f} s"
        return f"{text}: check what they share, the plugs, supply, SDA and SCL of the mux or board"
    # Only the sensor with the fewest answers is named: on a busy computer the others miss a frame now and then, too.
    sensor = int(np.argmin(answers))
    moment = since_s[sensor]
    when = "" if moment is None or not answers[sensor] else f", and in none after {moment:.2f} s"
    return f"sensor {sensor + 1} answered in {answers[sensor]} of {len(frames)} frames{when}: check its wiring"


def _silent_at_the_end(frames: Sequence[Frame], sensor: int) -> Sequence[Frame]:
    """The last frames, in which the sensor no longer answers."""
    count = next((back for back, frame in enumerate(reversed(frames)) if frame.valid[sensor]), len(frames))
    return frames[len(frames) - count :]


def _seconds_between(first: Frame, last: Frame) -> float:
    return (last.device_time_us - first.device_time_us) * 1e-6


def _require(good: NDArray[np.bool_], sentence: Callable[[int], str]) -> None:
    """BaselineError with the sentence for the first sensor that is not good."""
    if not good.all():
        raise BaselineError(sentence(int(np.argmin(good))))
