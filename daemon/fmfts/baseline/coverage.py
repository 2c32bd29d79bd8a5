"""Guides a person who turns the robot or presses the pad: what is done, and what is still missing.

It may end a recording early; the estimation decides whether the recording is good enough.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length, lengths, product, singular_values
from fmfts.baseline.chips_found import MOSTLY
from fmfts.baseline.turn import ORIENTATIONS, SMALLEST_SHARE, SMALLEST_SWEEP_T
from fmfts.baseline.window_means import MEAN_OF
from fmfts.pad import Pad
from fmfts.sensor import Frame

Array = NDArray[np.float64]

# More than the estimation needs at least, so that an early end costs no noticeable accuracy.
SWEEP_SHARE = 1.4 * SMALLEST_SHARE
# Interval of evaluations of the whole recording, each of which takes longer than a frame.
LOOK_FRAMES = 55
# A press begins where the field changes by more than the first, and ends below the second. Noise alone makes 0.7 µT, a
# touch of 0.3 N at a corner of the standard pad 7.6 µT.
PRESS_BEGINS_T, PRESS_ENDS_T = 3e-6, 1.8e-6
REST_FRAMES = 44  # the field of the untouched pad is the median of so many first frames
ENOUGH_PRESSES, ENOUGH_IN_PART = 30, 4
# Light and firm presses: smallest ratio of the strongest change of the field to the weakest.
ENOUGH_RANGE = 3.0


class Coverage(Protocol):
    """Give it every frame. `enough`: more would not help much. `hint`: what to do now, as a sentence."""

    @property
    def enough(self) -> bool: ...
    @property
    def hint(self) -> str: ...
    def take(self, frame: Frame) -> None: ...


class TurnCoverage:
    """How far the ambient field has swept along its three main directions, in the axes of the pad."""

    def __init__(self, pad: Pad) -> None:
        self._pad = pad
        self._seen: list[Array] = []
        self._frames = 0
        self._sweep_t = np.zeros(3)
        self._least_swept = np.zeros(3)

    def take(self, frame: Frame) -> None:
        field_t = frame.field_t
        self._frames += 1
        # Single frames: the mean of a fast turning field is too short, and their noise is negligible beside the sweep.
        if self._frames % MEAN_OF == 0 and np.isfinite(field_t).all():
            self._seen.append(self._pad.sensors.to_pad(field_t[None])[0].mean(axis=0))
        if self._frames % LOOK_FRAMES == 0 and len(self._seen) >= 3:
            swept = np.array(self._seen) - np.mean(self._seen, axis=0)
            directions = singular_values(swept)[2]
            self._sweep_t = np.array(sorted(np.ptp(product(swept, directions), axis=0).tolist(), reverse=True))
            self._least_swept = directions[:, -1]

    @property
    def enough(self) -> bool:
        return len(self._seen) >= ORIENTATIONS and not self._missing

    @property
    def hint(self) -> str:
        if self._frames < LOOK_FRAMES:
            return "start now: turn the unloaded robot half around about one axis; nothing may touch the pad"
        if self._missing:
            return self._missing
        done = min(len(self._seen) / ORIENTATIONS, 1.0)
        return f"all directions are there: go on turning ({100 * done:.0f} % of the orientations)"

    @property
    def _missing(self) -> str:
        first, _, last = self._sweep_t
        if first < 2.0 * SMALLEST_SWEEP_T:
            return "the field hardly turns yet: turn the robot half around about one axis"
        needed = max(SMALLEST_SWEEP_T, SWEEP_SHARE * first)
        if last < needed:
            # In steps of ten: a hint that changes all the time cannot be read.
            done = f"{10 * int(10.0 * last / needed)} % of what it needs"
            return f"turn about another axis, across the first{self._first_axis}: {done}"
        return ""

    @property
    def _first_axis(self) -> str:
        """The pad's axis about which the robot turned: the field moved around it, not along it."""
        along = np.abs(self._least_swept)
        return f" (the pad's {'xyz'[int(np.argmax(along))]})" if along.max() > MOSTLY else ""


class PressCoverage:
    """How many presses there were, in how many parts of the pad, and how different in strength.

    Presses that change the same sensor's field most count as one part. Which part of the pad that is depends on how its
    silicone moves the magnet (on the standard pad, the part across from the sensor), so parts have no names.
    """

    def __init__(self, pad: Pad, wanted: int = ENOUGH_PRESSES) -> None:
        self._pad = pad
        self._wanted = wanted
        self._first: list[Array] = []
        self._rest: Array | None = None
        self._peak: Array | None = None  # the largest change in the present press
        self._in_part = np.zeros(len(pad.sensors), dtype=np.intp)
        self._weakest_t, self._strongest_t = np.inf, 0.0

    def take(self, frame: Frame) -> None:
        field_t = frame.field_t
        if not np.isfinite(field_t).all():
            return
        if self._rest is None:
            self._first.append(field_t)
            if len(self._first) == REST_FRAMES:
                self._rest = np.median(self._first, axis=0)
            return
        change = self._pad.sensors.to_pad((field_t - self._rest)[None])[0]
        change = change - change.mean(axis=0)  # a change that all sensors have in common is no press
        size = length(change.ravel())
        if size > PRESS_BEGINS_T and (self._peak is None or size > length(self._peak.ravel())):
            self._peak = change
        elif size < PRESS_ENDS_T and self._peak is not None:
            self._count(self._peak)
            self._peak = None

    def _count(self, peak: Array) -> None:
        self._in_part[int(np.argmax(lengths(peak)))] += 1
        size = length(peak.ravel())
        self._weakest_t, self._strongest_t = min(self._weakest_t, size), max(self._strongest_t, size)

    @property
    def presses(self) -> int:
        return int(self._in_part.sum())

    @property
    def enough(self) -> bool:
        return self.presses >= self._wanted and not self._missing

    @property
    def hint(self) -> str:
        if self._rest is None:
            return "do not touch the pad yet"
        if not self.presses:
            return f"start now: press some {self._wanted} times, each for a moment, all over the pad"
        missing = self._missing
        counted = f"{self.presses} of {self._wanted} presses"
        return f"{counted}; still missing: {missing}" if missing else f"{counted}, well spread: go on"

    @property
    def _missing(self) -> str:
        """The lacks of the presses, besides their number."""
        missing = []
        lacking = int((self._in_part < ENOUGH_IN_PART).sum())
        if lacking:
            parts = len(self._in_part)
            missing.append(
                f"{ENOUGH_IN_PART} presses in each of {lacking} of {parts} parts of the pad (press all over)"
            )
        if self._strongest_t < ENOUGH_RANGE * self._weakest_t:
            missing.append("lighter and firmer ones")
        return ", ".join(missing)
