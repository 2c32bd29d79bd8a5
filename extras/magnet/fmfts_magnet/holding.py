"""Finds in a pad's frames when a hand holds a magnet still, and averages the readings."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.sensor.frame import Frame
from fmfts_magnet.readings import Array, Readings

HOLD_S = 1.0  # duration of a mean; a trembling hand changes all chips' fields alike
PARTS = 4
FEWEST_FRAMES = 12
# The parts' means may differ by this share of the field: 3 % is 0.4 mm at 40 mm.
STEADY = 0.04
STEADY_T = 2e-6
STEADY_DEVIATIONS = 5.0
LEAST_FIELD_T = 2e-5  # of the sensor that sees most; weaker, the errors of the ambient field exceed those of gains
MOVED = 0.15  # share of the field: a smaller change between two steps counts as the same place
SATURATED_SHARE = 0.05


@dataclass(frozen=True, slots=True)
class Held:
    """mean_t (N, 3) in the chips' axes, NaN where an axis was not measured; noise_t (N, 3): its standard deviation."""

    mean_t: Array
    noise_t: Array


class Hold:
    """Waits for one step. before: without a magnet, None for that step itself. last: the step before, if any."""

    def __init__(self, before: Held | None = None, last: Held | None = None) -> None:
        self._before, self._last = before, last
        self._fields: deque[tuple[float, Array, NDArray[np.bool_]]] = deque()
        self.held: Held | None = None
        self.hint = "waiting for frames"
        self.is_judged = False  # whether a whole second of frames was examined

    def take(self, frame: Frame, is_asked: bool = False) -> None:
        """Sets `held` once the magnet is held still, or when the person asks for it and it can be used; else `hint`."""
        now_s = frame.host_time_ns * 1e-9
        self._fields.append((now_s, frame.field_t, frame.overflow))
        while self._fields and now_s - self._fields[0][0] > HOLD_S:
            self._fields.popleft()
        self.hint = "reading: hold still"
        if len(self._fields) < FEWEST_FRAMES or now_s - self._fields[0][0] < 0.8 * HOLD_S:
            return
        self.is_judged = True
        held, apart = self._averaged()
        self.hint = self._refused(held, apart, is_asked)
        self.held = None if self.hint else held

    def _averaged(self) -> tuple[Held, Array]:
        """The mean, and (N, 3) by how much the means of the parts of the time differ."""
        fields = np.array([field for _, field, _ in self._fields])
        known = np.isfinite(fields)
        enough = known.mean(axis=0) > 1.0 - SATURATED_SHARE
        filled = np.where(known, fields, 0.0)
        count = np.maximum(known.sum(axis=0), 1)
        mean = filled.sum(axis=0) / count
        parts = [
            part.sum(axis=0) / np.maximum(is_known.sum(axis=0), 1)
            for part, is_known in zip(np.array_split(filled, PARTS), np.array_split(known, PARTS), strict=True)
        ]
        # Differences of neighbours: a slow movement is no noise.
        steps = np.where(known[1:] & known[:-1], np.diff(filled, axis=0), 0.0)
        noise = np.sqrt((steps * steps).mean(axis=0) / 2.0 / count)
        held = Held(np.where(enough, mean, np.nan), noise)
        return held, np.where(enough, np.ptp(np.array(parts), axis=0), 0.0)

    def _refused(self, held: Held, apart: Array, is_asked: bool) -> str:
        """Why this is not accepted, and what to do; "" if it is."""
        overflow = np.array([each for _, _, each in self._fields]).mean(axis=0) > SATURATED_SHARE
        if self._before is not None:
            fresh = overflow & np.isfinite(self._before.mean_t)
            if fresh.any():
                sensor = int(np.argmax(fresh.any(axis=1)))
                return f"too strong: sensor {sensor + 1} is saturated. Hold the magnet higher"
            change = held.mean_t - self._before.mean_t
        else:
            change = np.zeros_like(held.mean_t)
        if not np.isfinite(change).any():
            return "no sensor measures: `fmfts-daemon probe` says why"
        field_t = float(np.nanmax(np.abs(change)))
        if self._before is not None and field_t < LEAST_FIELD_T:
            return f"too weak: {field_t * 1e6:.0f} of at least {LEAST_FIELD_T * 1e6:.0f} µT. Hold the magnet lower"
        if self._last is not None:
            moved_t = float(np.nanmax(np.abs(held.mean_t - self._last.mean_t)))
            if moved_t < MOVED * field_t:
                return f"{field_t * 1e6:.0f} µT: move the magnet to the new place"
        limit = np.maximum(STEADY * field_t, STEADY_T) + STEADY_DEVIATIONS * np.sqrt(PARTS) * held.noise_t
        if (apart > limit).any() and not is_asked:
            return f"{field_t * 1e6:.0f} µT, unsteady by {float(apart.max()) * 1e6:.1f} µT: hold still for a second"
        return ""


def readings_of(before: Held, steps: list[Held]) -> Readings:
    """The magnet's field in each step: the readings minus those without it."""
    change = np.array([step.mean_t - before.mean_t for step in steps])
    noise = np.sqrt(before.noise_t**2 + np.mean([step.noise_t**2 for step in steps], axis=0))
    return Readings(change, noise)
