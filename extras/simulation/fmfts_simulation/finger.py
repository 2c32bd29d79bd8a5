"""Simulates a finger that taps, presses, slides and once squeezes too hard; the same seed repeats it.

Time is in seconds since the pad was switched on. Any function from time to Touch can be a finger.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from math import cos, hypot, pi
from typing import NamedTuple

import numpy as np

from fmfts.config import SimulatedSource
from fmfts.pad import Array

UNLOADED_AT_START_S = 4.0  # time for a baseline before anything touches
CYCLE_S = 12.0
REACH_M = 8e-3  # the script touches only where this pad's estimates are good
SQUEEZE_N = 2.6  # beyond the 1.98 N up to which the pad was calibrated


class Touch(NamedTuple):
    x_m: float
    y_m: float
    force_n: float
    shear_x_n: float = 0.0
    shear_y_n: float = 0.0


Finger = Callable[[float], Touch]


def columns(touches: Sequence[Touch]) -> list[Array]:
    """The arguments of a pad's mechanics: x, y, force (K,), and shear along x and y if there is any."""
    press = np.fromiter(chain.from_iterable(touches), float).reshape(-1, len(Touch._fields)).T
    return list(press if press[3:].any() else press[:3])


def no_finger(time_s: float) -> Touch:
    return Touch(0.0, 0.0, 0.0)


def steady_finger(x_m: float, y_m: float, force_n: float) -> Finger:
    """A finger that presses without end, always the same."""
    touch = Touch(x_m, y_m, force_n)
    return lambda time_s: touch


@dataclass(frozen=True, slots=True)
class Stroke:
    """One contact of `duration_s`, with force ramps of `ramp_s` at both ends, at even speed from `start_m` to `end_m`.

    friction: shear in the direction of its motion, as a share of its force.
    """

    begin_s: float
    duration_s: float
    ramp_s: float
    force_n: float
    start_m: tuple[float, float]
    end_m: tuple[float, float]
    friction: float = 0.0

    def at(self, time_s: float) -> Touch:
        elapsed = time_s - self.begin_s
        travelled = min(max(elapsed / self.duration_s, 0.0), 1.0)
        x, y = (start + (end - start) * travelled for start, end in zip(self.start_m, self.end_m, strict=True))
        from_edge = min(elapsed, self.duration_s - elapsed)
        rise = min(max(from_edge / self.ramp_s, 0.0), 1.0)
        force_n = self.force_n * (1.0 - cos(pi * rise)) / 2.0
        return Touch(x, y, force_n, *(self.friction * force_n * along for along in self._direction))

    @property
    def _direction(self) -> tuple[float, float]:
        """Unit vector of its motion; zero where it does not move."""
        x, y = (end - start for start, end in zip(self.start_m, self.end_m, strict=True))
        way = hypot(x, y)
        return (x / way, y / way) if way > 0.0 else (0.0, 0.0)


class ScriptedFinger:
    """Three taps, a press, a slide, a light touch and a squeeze every twelve seconds, with rests between.

    friction: of the slide.
    """

    def __init__(self, seed: int, friction: float = 0.0) -> None:
        self._seed = seed
        self._friction = friction

    def __call__(self, time_s: float) -> Touch:
        cycle, within_s = divmod(time_s - UNLOADED_AT_START_S, CYCLE_S)
        strokes = _strokes(self._seed, max(int(cycle), 0), self._friction)
        begun = [stroke for stroke in strokes if stroke.begin_s <= within_s]
        if cycle < 0 or not begun:
            return Touch(*strokes[0].start_m, 0.0)
        return begun[-1].at(within_s)


MEETING_S = 10.0  # after which two fingers that meet begin again


class MeetingFingers:
    """Two fingers: one presses and stays, the other comes, slides up to it, and goes away again.

    They are 15 mm apart at first and 4 mm at the nearest, where no pad distinguishes them.
    """

    def __init__(self, seed: int) -> None:
        self._staying_n, self._coming_n = np.random.default_rng((seed, 2)).uniform(0.6, 1.0, 2).tolist()

    def staying(self, time_s: float) -> Touch:
        return Touch(-6e-3, -1e-3, self._staying_n * _eased(_within(time_s), 0.5, 9.0))

    def coming(self, time_s: float) -> Touch:
        within_s = _within(time_s)
        near = min(max((within_s - 1.8) / 2.5, 0.0), 1.0) - min(max((within_s - 4.8) / 2.5, 0.0), 1.0)
        return Touch(9e-3 - 11e-3 * near, 2e-3 * (1.0 - near), self._coming_n * _eased(within_s, 1.5, 8.0))


def _within(time_s: float) -> float:
    """The time since the last beginning of MeetingFingers; before the first one, a time before it."""
    since_s = time_s - UNLOADED_AT_START_S
    return since_s if since_s < 0.0 else since_s % MEETING_S


def _eased(time_s: float, begin_s: float, end_s: float, ramp_s: float = 0.3) -> float:
    """From 0 to 1 after `begin_s`, and back to 0 at `end_s`."""
    rise = min(max(min(time_s - begin_s, end_s - time_s) / ramp_s, 0.0), 1.0)
    return (1.0 - cos(pi * rise)) / 2.0


def fingers_of(source: SimulatedSource) -> tuple[Finger, Finger | None]:
    """The finger that the config names, and the second one, if there is one."""
    if source.finger != "script":
        return no_finger, None
    if source.fingers == 2:
        both = MeetingFingers(source.seed)
        return both.staying, both.coming
    return ScriptedFinger(source.seed, source.finger_friction), None


@lru_cache(maxsize=64)
def _strokes(seed: int, cycle: int, friction: float) -> tuple[Stroke, ...]:
    """The strokes of one cycle; the places and most forces differ from cycle to cycle."""
    random = np.random.default_rng((seed, cycle))

    def stroke(begin_s: float, duration_s: float, ramp_s: float, force_n: float, slides: bool = False) -> Stroke:
        places = random.uniform(-REACH_M, REACH_M, (2, 2))
        start, end = ((float(x), float(y)) for x, y in places)
        return Stroke(begin_s, duration_s, ramp_s, force_n, start, end if slides else start, friction)

    return (
        stroke(0.2, 0.12, 0.05, random.uniform(0.4, 1.0)),
        stroke(0.7, 0.15, 0.06, random.uniform(0.6, 1.4)),
        stroke(1.2, 0.20, 0.08, random.uniform(0.8, 1.8)),
        stroke(2.2, 2.0, 0.40, random.uniform(0.8, 1.9)),
        stroke(4.8, 2.7, 0.25, random.uniform(0.8, 1.5), slides=True),
        stroke(8.0, 1.2, 0.30, random.uniform(0.1, 0.3)),
        stroke(9.8, 0.7, 0.20, SQUEEZE_N),
    )
