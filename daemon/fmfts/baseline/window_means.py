"""Averages the frames of a moving field over short windows, each with its time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.baseline.recording import FEW_FRAMES, MINIMUM_FRAMES, BaselineError
from fmfts.pose import Alignment
from fmfts.sensor.frame import Frame
from fmfts.sensor.missing import SILENT, missing_sensors

Array = NDArray[np.float64]

# 50 ms at 220 Hz: a third of the noise of one sample, and a hand moves little in that time.
MEAN_OF = 11


@dataclass(frozen=True, slots=True)
class Means:
    """field_t (K, N, 3) in sensor axes, each the mean of MEAN_OF frames. wander_t (K,): how far the field moved in it.

    time_s (K,) since the recording began. noise_t (N, 3): standard deviation of one sample.
    """

    field_t: Array
    wander_t: Array
    time_s: Array
    noise_t: Array


def means(frames: Sequence[Frame]) -> Means:
    """Average frames, each brought to one instant first (chips run free). BaselineError if too few are complete."""
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
    fields, times = fields[whole], times[whole]
    count = len(fields) // MEAN_OF
    blocks = fields[: count * MEAN_OF].reshape(count, MEAN_OF, *fields.shape[1:])
    half = MEAN_OF // 2
    return Means(
        field_t=blocks.mean(axis=1),
        wander_t=np.abs(blocks[:, :half].mean(axis=1) - blocks[:, -half:].mean(axis=1)).max(axis=(1, 2)),
        time_s=(times[: count * MEAN_OF].reshape(count, MEAN_OF).mean(axis=1) - times[0]) * 1e-6,
        noise_t=_noise(frames),
    )


def _what_is_wrong(frames: Sequence[Frame], sensor: int) -> str:
    """With a sensor that is missing in many frames: what the last of them shows."""
    found = (missing_sensors(frame).get(sensor) for frame in reversed(frames))
    what = next((each for each in found if each is not None), SILENT)
    return f"{what}: check its wiring" if what == SILENT else what


def _aligned(frames: Sequence[Frame]) -> tuple[Array, Array]:
    """Fields (K, N, 3) and their instants (K,) in µs."""
    span_us = frames[-1].device_time_us - frames[0].device_time_us
    alignment = Alignment(len(frames[0].valid), period_us=span_us / (len(frames) - 1))
    pushed = [alignment.push(frame.field_t, frame.sampled_us, frame.fresh, frame.timed) for frame in frames]
    return np.array([one.field_t for one in pushed]), np.array([one.time_us for one in pushed], dtype=np.float64)


def _noise(frames: Sequence[Frame]) -> Array:
    """(N, 3) standard deviation of one sample, from the samples themselves: interpolation would smooth the noise.

    Second differences show the noise (times √6) without a turn or a press.
    """
    fields, fresh = np.array([frame.field_t for frame in frames]), np.array([frame.fresh for frame in frames])
    differences = (np.diff(fields[fresh[:, sensor], sensor], 2, axis=0) for sensor in range(fields.shape[1]))
    noise = np.array([_robust_deviation(of_sensor) for of_sensor in differences]) / np.sqrt(6.0)
    # Rounding to counts sets the lower limit of the noise.
    floored: Array = np.maximum(noise, frames[0].chip.coarseness_t(frames[0].gain_code) / np.sqrt(12.0))
    return floored


def _robust_deviation(differences: Array) -> Array:
    """Standard deviation along the first axis, without outliers beyond four times a rough one from the median of the
    squares. The median alone would not do: as a median of counts it is itself a count."""
    squares = square(differences)
    rough = np.nanmedian(squares, axis=0) / 0.4549  # the median of χ² with one degree
    deviation: Array = np.sqrt(np.nanmean(np.where(squares <= 16.0 * rough, squares, np.nan), axis=0))
    return deviation
