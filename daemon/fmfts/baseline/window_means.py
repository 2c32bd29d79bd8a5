"""Averages the frames of a moving field over short windows, each with its time.

If a field turns by θ within a window, its mean is θ²/24 too short: fast turns get shorter windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import lengths
from fmfts.baseline.recording import FEW_FRAMES, MINIMUM_FRAMES, BaselineError
from fmfts.pose import Alignment
from fmfts.sensor.frame import Frame, fields_of
from fmfts.sensor.missing import SILENT, missing_sensors

Array = NDArray[np.float64]

# 50 ms at 220 Hz: a third of the noise of one sample, and a hand moves little in that time.
MEAN_OF = 11
# The mean of a vector that turns by this arc (rad) is 0.25 % too short: half as much as a workshop's field varies.
LARGEST_ARC = 0.25
STILLEST = 0.1  # share of a fast turn's samples that determine the noise


@dataclass(frozen=True, slots=True)
class Means:
    """field_t (K, N, 3) in sensor axes, each the mean of `mean_of` frames.

    wander_t (K,): how far the field moved in it. time_s (K,) since `first_us`, the board's time of the first frame.
    noise_t (N, 3): standard deviation of one sample.
    """

    field_t: Array
    wander_t: Array
    time_s: Array
    noise_t: Array
    mean_of: int = MEAN_OF
    first_us: float = 0.0


def means(frames: Sequence[Frame]) -> Means:
    """Average frames, each brought to one instant first (chips run free). BaselineError if too few are complete."""
    fields, times = _whole(frames)
    return _means_of(fields, times, _noise(frames), MEAN_OF)


def turning_means(frames: Sequence[Frame]) -> Means:
    """Like `means`, over windows that are short enough for the field's speed."""
    fields, times = _whole(frames)
    window = turning_window(fields)
    return _means_of(fields, times, _noise(frames, 1.0 if window == MEAN_OF else STILLEST), window)


def turning_window(fields: Array) -> int:
    """The largest number of frames, up to MEAN_OF, within which fields (K, N, 3) that turn go at most LARGEST_ARC.

    Nine in ten windows must keep that limit, at the median of the sensors, because a chip may jump.
    """
    allowed = LARGEST_ARC * np.ptp(fields, axis=0).max(axis=1) / 2.0
    for window in range(MEAN_OF, 1, -1):
        chord = lengths(fields[window - 1 :] - fields[: len(fields) - window + 1])
        beyond = np.median(chord - allowed, axis=1)
        if np.count_nonzero(beyond <= 0.0) >= 0.9 * len(beyond):
            return window
    return 1


def _whole(frames: Sequence[Frame]) -> tuple[Array, Array]:
    """Fields (K, N, 3) of the frames without a missing value, at one instant each, and those instants (K,) in µs."""
    if len(frames) < MINIMUM_FRAMES:
        raise BaselineError(f"only {len(frames)} frames arrived of at least {MINIMUM_FRAMES}: {FEW_FRAMES}")
    if len({frame.gain_code for frame in frames}) > 1:
        raise BaselineError("the range was changed during the recording: record again")
    fields, times = _aligned(frames)
    absent: NDArray[np.bool_] = np.asarray(np.isnan(fields).any(axis=2), dtype=np.bool_)
    whole: NDArray[np.bool_] = np.asarray(~absent.any(axis=1), dtype=np.bool_)
    if whole.sum() < max(MINIMUM_FRAMES, len(frames) // 2):
        sensor = int(np.argmax(absent.sum(axis=0)))
        raise BaselineError(
            f"only {whole.sum()} of {len(frames)} frames are whole: in {absent[:, sensor].sum()}, sensor {sensor + 1} "
            f"is {_what_is_wrong(frames, sensor)}"
        )
    return fields[whole], times[whole]


def _means_of(fields: Array, times: Array, noise_t: Array, mean_of: int) -> Means:
    count = len(fields) // mean_of
    blocks = fields[: count * mean_of].reshape(count, mean_of, *fields.shape[1:])
    half = max(mean_of // 2, 1)
    return Means(
        field_t=blocks.mean(axis=1),
        wander_t=np.abs(blocks[:, :half].mean(axis=1) - blocks[:, -half:].mean(axis=1)).max(axis=(1, 2)),
        time_s=(times[: count * mean_of].reshape(count, mean_of).mean(axis=1) - times[0]) * 1e-6,
        noise_t=noise_t,
        mean_of=mean_of,
        first_us=float(times[0]),
    )


def _what_is_wrong(frames: Sequence[Frame], sensor: int) -> str:
    """If a sensor is missing in many frames, the error is about the last of them."""
    found = (missing_sensors(frame).get(sensor) for frame in reversed(frames))
    what = next((each for each in found if each is not None), SILENT)
    return f"{what}: check its wiring" if what == SILENT else what


def _aligned(frames: Sequence[Frame]) -> tuple[Array, Array]:
    """Fields (K, N, 3) and their instants (K,) in µs."""
    span_us = frames[-1].device_time_us - frames[0].device_time_us
    alignment = Alignment(len(frames[0].valid), period_us=span_us / (len(frames) - 1))
    pushed = [
        alignment.push(field, frame.sampled_us, frame.fresh, frame.timed)
        for field, frame in zip(fields_of(frames), frames, strict=True)
    ]
    return np.array([one.field_t for one in pushed]), np.array([one.time_us for one in pushed], dtype=np.float64)


def _noise(frames: Sequence[Frame], stillest: float = 1.0) -> Array:
    """(N, 3) standard deviation of one sample, from the samples themselves: interpolation would smooth the noise.

    Second differences show the noise (times √6) without a turn or a press; of a field that turns fast, only this share
    of them, where it moves least. How far it moves from the sample before to the one after shares no noise with them.
    """
    fields, fresh = fields_of(frames), np.array([frame.fresh for frame in frames])
    noise = np.array([_noise_of(fields[fresh[:, sensor], sensor], stillest) for sensor in range(fields.shape[1])])
    # Rounding to counts sets the lower limit of the noise.
    floored: Array = np.maximum(noise, frames[0].chip.coarseness_t(frames[0].gain_code) / np.sqrt(12.0))
    return floored


def _noise_of(samples: Array, stillest: float) -> Array:
    """The noise (3,) of one sensor's samples (K, 3)."""
    moved = lengths(samples[2:] - samples[:-2])
    still = np.argsort(moved)[: round(stillest * len(moved))]
    noise: Array = _robust_deviation(np.diff(samples, 2, axis=0)[still]) / np.sqrt(6.0)
    return noise


def _robust_deviation(differences: Array) -> Array:
    """Standard deviation along the first axis, without outliers beyond four times a rough one from the median of the
    squares. The median alone is too coarse: a median of counts is itself a count."""
    squares = square(differences)
    rough = np.nanmedian(squares, axis=0) / 0.4549  # the median of χ² with one degree
    deviation: Array = np.sqrt(np.nanmean(np.where(squares <= 16.0 * rough, squares, np.nan), axis=0))
    return deviation
