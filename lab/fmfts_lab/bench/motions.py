"""Motions of a finger, drawn by a seed, with which `bench now` measures the age of a contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts_simulation.finger import Finger, Touch, no_finger

REACH_M = 6e-3
PERIOD_S = 0.35  # period of taps, releases and ramps, each at another place
WAIT_S, START_S = 0.1, 0.02  # time before and after a slide; time in which a slide reaches its speed
STICK_S, SLIP_S, SLIP_M, SLIP_N = 0.06, 0.01, 0.6e-3, 0.1

# Time since the beginning of one event (s) → touch.
Event = Callable[[float], Touch]


@dataclass(frozen=True, slots=True)
class Motion:
    """finger: from time to touch. windows: the times (begin, end) in s at which errors count."""

    name: str
    finger: Finger
    windows: tuple[tuple[float, float], ...]

    def truth(self, times_s: Array) -> Array:
        """(K, 3) the true x, y (m) and force (N)."""
        return np.array([self.finger(moment)[:3] for moment in times_s.tolist()])

    def counts(self, times_s: Array) -> NDArray[np.bool_]:
        """Whether errors at these times count."""
        inside = np.zeros(len(times_s), dtype=np.bool_)
        for begin, end in self.windows:
            inside |= (times_s >= begin) & (times_s <= end)
        return inside


Draw = Callable[[np.random.Generator, float], Motion]


def place(random: np.random.Generator, reach_m: float = REACH_M) -> tuple[float, float]:
    """Uniform over a disc."""
    radius, angle = reach_m * random.uniform() ** 0.5, random.uniform(0.0, 2.0 * pi)
    return float(radius * cos(angle)), float(radius * sin(angle))


def _repeated(
    name: str, random: np.random.Generator, seconds: float, event: Callable[[], Event], window: tuple[float, float]
) -> Motion:
    """One event each PERIOD_S, at an instant that no frame knows. window: since the beginning of an event."""
    begins = [PERIOD_S * number + float(random.uniform(0.0, 5e-3)) for number in range(int(seconds / PERIOD_S))]
    events = [event() for _ in begins]

    def finger(time_s: float) -> Touch:
        number = min(max(int(time_s / PERIOD_S), 0), len(begins) - 1)
        return events[number](time_s - begins[number])

    return Motion(name, finger, tuple((begin + window[0], begin + window[1]) for begin in begins))


def tap(duration_s: float) -> Draw:
    """1 N, up and down in `duration_s`."""

    def draw(random: np.random.Generator, seconds: float) -> Motion:
        def event() -> Event:
            x_m, y_m = place(random)

            def touch(since_s: float) -> Touch:
                within = (since_s - 0.1) / duration_s
                return Touch(x_m, y_m, 0.5 * (1.0 - cos(2.0 * pi * within)) if 0.0 < within < 1.0 else 0.0)

            return touch

        name = f"tap in {duration_s * 1e3:g} ms"
        return _repeated(name, random, seconds, event, (0.09, 0.1 + duration_s + 0.015))

    return draw


def release(duration_s: float) -> Draw:
    """From 1 N to nothing in `duration_s`."""

    def draw(random: np.random.Generator, seconds: float) -> Motion:
        def event() -> Event:
            x_m, y_m = place(random)

            def touch(since_s: float) -> Touch:
                up, down = min(max(since_s / 0.08, 0.0), 1.0), min(max((since_s - 0.2) / duration_s, 0.0), 1.0)
                return Touch(x_m, y_m, 0.5 * (cos(pi * down) - cos(pi * up)) if down < 1.0 else 0.0)

            return touch

        name = f"release in {duration_s * 1e3:g} ms"
        return _repeated(name, random, seconds, event, (0.195, 0.2 + duration_s + 0.015))

    return draw


def ramp(random: np.random.Generator, seconds: float) -> Motion:
    """30 N/s to 1.5 N; then slowly back."""

    def event() -> Event:
        x_m, y_m = place(random)

        def touch(since_s: float) -> Touch:
            up, down = min(max((since_s - 0.1) * 30.0, 0.0), 1.5), min(max((since_s - 0.18) / 0.15, 0.0), 1.0)
            return Touch(x_m, y_m, up * 0.5 * (1.0 + cos(pi * down)))

        return touch

    return _repeated("ramp 30 N/s", random, seconds, event, (0.095, 0.165))


def _whole(seconds: float) -> tuple[tuple[float, float], ...]:
    return ((0.2, seconds),)


def untouched(random: np.random.Generator, seconds: float) -> Motion:
    return Motion("untouched", no_finger, _whole(seconds))


def hold(random: np.random.Generator, seconds: float) -> Motion:
    """A new place and force each second."""
    holds = [(*place(random), float(random.uniform(0.3, 1.8))) for _ in range(int(seconds) + 1)]

    def finger(time_s: float) -> Touch:
        x_m, y_m, force_n = holds[min(max(int(time_s), 0), len(holds) - 1)]
        within_s = time_s % 1.0
        rise = min(max(within_s / 0.1, 0.0), 1.0, max((0.98 - within_s) / 0.1, 0.0))
        return Touch(x_m, y_m, force_n * 0.5 * (1.0 - cos(pi * rise)))

    return Motion("hold", finger, tuple((number + 0.2, number + 0.85) for number in range(int(seconds))))


def light_hold(random: np.random.Generator, seconds: float) -> Motion:
    """20 mN in the middle, where the pad detects them."""
    x_m, y_m = place(random, 2e-3)
    return Motion("hold 20 mN", lambda time_s: Touch(x_m, y_m, 0.02 if time_s > 0.1 else 0.0), _whole(seconds))


def slide(speed_m_s: float) -> Draw:
    """Straight strokes of 12 mm across the pad, or of 0.9 s; START_S to gain the speed and to lose it."""
    length_m = min(12e-3, 0.9 * speed_m_s)
    lasts_s = length_m / speed_m_s + START_S
    cycle_s = lasts_s + 2.0 * WAIT_S

    def draw(random: np.random.Generator, seconds: float) -> Motion:
        strokes = [_stroke(random, length_m, speed_m_s) for _ in range(int(seconds / cycle_s))]

        def finger(time_s: float) -> Touch:
            number, within_s = divmod(time_s, cycle_s)
            force_n, x_m, y_m, by_x, by_y = strokes[min(max(int(number), 0), len(strokes) - 1)]
            moved_s = _eased(within_s - WAIT_S) - _eased(within_s - WAIT_S - length_m / speed_m_s)
            rise = max(min(within_s / 0.05, (cycle_s - within_s) / 0.05, 1.0), 0.0)
            return Touch(x_m + by_x * moved_s, y_m + by_y * moved_s, force_n * 0.5 * (1.0 - cos(pi * rise)))

        windows = tuple((number * cycle_s + WAIT_S, (number + 1) * cycle_s - WAIT_S) for number in range(len(strokes)))
        return Motion(f"slide {speed_m_s * 1e3:g} mm/s", finger, windows)

    return draw


def _stroke(random: np.random.Generator, length_m: float, speed_m_s: float) -> tuple[float, ...]:
    """Force, where it begins (x, y), and its velocity (x, y)."""
    angle, aside_m, force_n = random.uniform(0.0, 2.0 * pi), random.uniform(-3e-3, 3e-3), random.uniform(0.5, 1.5)
    along = np.array([cos(angle), sin(angle)])
    begin = aside_m * np.array([-along[1], along[0]]) - along * length_m / 2.0
    return (float(force_n), *begin.tolist(), *(along * speed_m_s).tolist())


def _eased(time_s: float) -> float:
    """The integral of a speed that rises from 0 to 1 in START_S."""
    if time_s <= 0.0:
        return 0.0
    return time_s * time_s / (2.0 * START_S) if time_s < START_S else time_s - START_S / 2.0


def stick_slip(random: np.random.Generator, seconds: float) -> Motion:
    """The finger sticks while its force rises, then slips by 0.6 mm while its force falls, again and again."""
    angle, force_n = random.uniform(0.0, 2.0 * pi), float(random.uniform(0.6, 1.4))
    along_x, along_y = cos(angle), sin(angle)
    cycle_s, strokes = STICK_S + SLIP_S, 14

    def finger(time_s: float) -> Touch:
        number, within_s = divmod(time_s, cycle_s)
        slipped = max(within_s - STICK_S, 0.0) / SLIP_S
        turn = (int(number) + slipped) % (2.0 * strokes)
        way_m = (min(turn, 2.0 * strokes - turn) - strokes / 2.0) * SLIP_M
        stuck = min(within_s / STICK_S, 1.0) - slipped
        return Touch(way_m * along_x, way_m * along_y, (force_n + SLIP_N * stuck) * min(max(time_s / 0.1, 0.0), 1.0))

    return Motion("stick-slip", finger, _whole(seconds))


DRAWN: Sequence[Draw] = (
    untouched,
    light_hold,
    hold,
    slide(10e-3),
    slide(100e-3),
    stick_slip,
    tap(50e-3),
    release(20e-3),
    ramp,
    tap(20e-3),
    release(5e-3),
)
