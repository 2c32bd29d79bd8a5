"""Fingers that press, stick, slip and roll, for `bench slip`: by the table of presses, and by CalculiX's drags.

The drags (finite_elements/drags.csv) are an independent world: another solver, other elements, and a ball under
Coulomb's law, whereas the estimator's table assumes uniform traction on a disc. They are quasi-static, so the speed is
free.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fmfts.pad import Array, Magnet
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Touch

DRAGS_PATH = Path(__file__).parents[1] / "finite_elements" / "drags.csv"
REACH_M = 7e-3  # place of the table's slips: shear is reported within 8 mm
PRESSED_S, HELD_S, AFTER_S, RELEASED_S = 0.2, 0.6, 0.6, 0.3
VIBRATION_HZ, VIBRATION_SHARE = 37.0, 0.15  # a slipping finger chatters: its speed and friction vary by this share
GROSS_SHARE = 0.8
TOOL, TOOL_NEAR_M, TOOL_FAR_M, TOOL_HZ = Magnet(5e-3, 10e-3, 0.3), 0.12, 0.3, 0.5


@dataclass(frozen=True, slots=True)
class Slide:
    """A Finger of the table: it presses, its shear grows to its friction in `ramp_s`, and it slips at an even speed."""

    start_m: Array
    along: Array
    force_n: float
    friction: float
    speed_m_per_s: float
    way_m: float
    ramp_s: float

    @classmethod
    def drawn(cls, random: np.random.Generator, speed_m_per_s: float) -> Slide:
        way_m = float(np.clip(0.25 * speed_m_per_s, 1e-3, 6e-3))
        while True:
            angle, start_m = random.uniform(0.0, 2.0 * np.pi), random.uniform(-REACH_M, REACH_M, 2)
            along = np.array([np.cos(angle), np.sin(angle)])
            if np.abs(start_m + way_m * along).max() < REACH_M:
                break
        friction, force_n = random.uniform(0.3, 1.2), random.uniform(0.6, 2.0)
        force_n = min(force_n, 2.0 / max(friction, 1.0))
        return cls(start_m, along, force_n, friction, speed_m_per_s, way_m, random.uniform(0.1, 0.8))

    @property
    def slips_s(self) -> tuple[float, float]:
        begin = 0.3 + PRESSED_S + HELD_S + self.ramp_s
        return begin, begin + self.way_m / self.speed_m_per_s

    @property
    def seconds(self) -> float:
        return self.slips_s[1] + AFTER_S + RELEASED_S

    def __call__(self, time_s: float) -> Touch:
        begin, end = self.slips_s
        rise = min(max((time_s - 0.3) / PRESSED_S, 0.0), 1.0) * min(max((end + AFTER_S - time_s) / 0.1 + 1.0, 0.0), 1.0)
        chatter = (
            VIBRATION_SHARE * np.sin(2.0 * np.pi * VIBRATION_HZ * (time_s - begin)) if begin < time_s < end else 0.0
        )
        pulled = min(max((time_s - begin + self.ramp_s) / self.ramp_s, 0.0), 1.0)
        shear_n = self.friction * self.force_n * rise * pulled * (1.0 + chatter / 3.0)
        swing_m = chatter * self.speed_m_per_s / (2.0 * np.pi * VIBRATION_HZ)
        place_m = self.start_m + (min(max(time_s - begin, 0.0) * self.speed_m_per_s, self.way_m) + swing_m) * self.along
        return Touch(*(float(v) for v in (*place_m, self.force_n * rise, *(shear_n * self.along))))


@dataclass(frozen=True, slots=True)
class Healthy:
    """A Finger that never slips: four seconds at each of five places. kind: see HEALTHY."""

    kind: str
    place_m: Array
    force_n: Array
    along: Array
    hertz: Array
    share: Array
    seconds: float = 20.0

    @classmethod
    def drawn(cls, random: np.random.Generator, kind: str) -> Healthy:
        angle = random.uniform(0.0, 2.0 * np.pi, 5)
        return cls(
            kind,
            random.uniform(-6e-3, 6e-3, (5, 2)),
            random.uniform(0.4, 2.0, 5),
            np.stack([np.cos(angle), np.sin(angle)], axis=1),
            random.uniform(0.3, 2.0, 5),
            random.uniform(0.1, 0.7, 5),
        )

    def __call__(self, time_s: float) -> Touch:
        i, within = min(int(time_s / 4.0), 4), time_s % 4.0
        rise = min(max((within - 0.3) / 0.2, 0.0), 1.0) * min(max((3.9 - within) / 0.15, 0.0), 1.0)
        place_m, force_n, shear_n = self.place_m[i], self.force_n[i] * rise, 0.0
        since = max(within - 0.6, 0.0)
        if self.kind == "shear":
            shear_n = self.share[i] * force_n * np.sin(2.0 * np.pi * self.hertz[i] * since)
        elif self.kind == "jerk":  # a load that comes within 20 ms and goes
            pulled = np.exp(-(within - 2.5) / 0.02) if within > 2.5 else 1.0 - np.exp(-max(within - 1.0, 0.0) / 0.02)
            shear_n = self.share[i] * force_n * pulled
        elif self.kind == "roll":
            rolled_m = 4e-3 * np.sin(2.0 * np.pi * 0.4 * self.hertz[i] * since)
            place_m = np.clip(place_m + rolled_m * self.along[i], -REACH_M, REACH_M)
        elif self.kind == "press":
            force_n *= 0.55 + 0.45 * np.sin(2.0 * np.pi * self.hertz[i] * within)
        return Touch(*(float(v) for v in (*place_m, force_n, *(shear_n * self.along[i]))))


HEALTHY = ("hold", "shear", "jerk", "roll", "press", "tool")


class ToolNearby(ManyFrames):
    """A magnetised tool swings between TOOL_NEAR_M and TOOL_FAR_M of the pad."""

    def _ambients(self, sampled_s: Array) -> Array:
        middle, half = (TOOL_NEAR_M + TOOL_FAR_M) / 2.0, (TOOL_FAR_M - TOOL_NEAR_M) / 2.0
        away_m = middle + half * np.cos(2.0 * np.pi * TOOL_HZ * sampled_s)
        place_m = away_m[..., None] * np.array([0.8, 0.0, 0.6])
        axis = np.broadcast_to(np.array([0.0, 0.6, 0.8]), place_m.shape)
        own = super()._ambients(sampled_s)
        return np.asarray(own + cylinder_field(self._built.pad.sensors.position_m, place_m, axis, TOOL))


@dataclass(frozen=True, slots=True)
class Drag:
    """One of CalculiX's drags, its increments one after the other. It is the mechanics of a pad, whose press is the
    number of the increment, as x in mm."""

    name: str
    friction: float
    way_mm: Array
    place_mm: Array
    load_n: Array
    response: Array
    largest_force_n: float = field(default=2.0)

    @classmethod
    def read(cls) -> list[Drag]:
        with DRAGS_PATH.open(newline="") as lines:
            rows = list(csv.DictReader(lines))
        return [
            cls._of(name, [row for row in rows if row["case"] == name])
            for name in dict.fromkeys(r["case"] for r in rows)
        ]

    @classmethod
    def _of(cls, name: str, rows: list[dict[str, str]]) -> Drag:
        def columns(*names: str) -> Array:
            return np.array([[float(row[each]) for each in names] for row in rows])

        movement = columns("dx_um", "dy_um", "dz_um", "axis_x", "axis_y") * [1e-6, 1e-6, 1e-6, 1.0, 1.0]
        return cls(
            name,
            float(rows[0]["friction"]),
            np.append(0.0, columns("way_mm")[:, 0]),
            np.vstack([columns("x_mm", "y_mm")[:1], columns("x_mm", "y_mm")]),
            np.vstack([np.zeros(3), columns("force_n", "shear_x_n", "shear_y_n")]),
            np.vstack([np.zeros(5), movement]),
        )

    def at(self, values: Array, number: Array) -> Array:
        """Linear between increments."""
        known = np.arange(len(values), dtype=float)
        return np.stack([np.interp(number, known, column) for column in values.T], axis=-1)

    def __call__(self, number: float) -> Array:
        return self.at(self.load_n, np.array(number))

    @property
    def first(self) -> int:
        """The last increment before it is dragged."""
        return int(np.flatnonzero(self.way_mm == 0.0)[-1])

    @property
    def slips_from_mm(self) -> float:
        """The drag at which the place moves nearly as fast as the ball: gross slip."""
        moved = np.linalg.norm(self.place_mm - self.place_mm[self.first], axis=1)
        share = np.diff(moved[self.first :]) / np.diff(self.way_mm[self.first :])
        first = int(np.flatnonzero(share > GROSS_SHARE)[0])
        return float(self.way_mm[self.first + first])

    def displace(self, x_m: Array) -> Array:
        return self.at(self.response, x_m * 1e3)


@dataclass(frozen=True, slots=True)
class Dragged:
    """A Finger: `Drag` at a speed. Its Touch has the number of the increment as x in mm."""

    drag: Drag
    speed_m_per_s: float

    @property
    def slips_s(self) -> tuple[float, float]:
        begin = 0.3 + 2.0 * PRESSED_S + HELD_S
        whole = self.drag.way_mm[-1]
        return begin + self.drag.slips_from_mm * 1e-3 / self.speed_m_per_s, begin + whole * 1e-3 / self.speed_m_per_s

    @property
    def seconds(self) -> float:
        return self.slips_s[1] + AFTER_S + RELEASED_S

    def __call__(self, time_s: float) -> Touch:
        first, last = self.drag.first, len(self.drag.way_mm) - 1
        pressed = min(max((time_s - 0.3) / (2.0 * PRESSED_S), 0.0), 1.0) * first
        way_mm = min(max(time_s - 0.3 - 2.0 * PRESSED_S - HELD_S, 0.0) * self.speed_m_per_s * 1e3, self.drag.way_mm[-1])
        number = np.interp(way_mm, self.drag.way_mm[first:], np.arange(first, last + 1)) if way_mm > 0.0 else pressed
        if time_s > self.slips_s[1] + AFTER_S:
            number = 0.0
        return Touch(float(number) * 1e-3, 0.0, float(self.drag(float(number))[0]))


class DragMechanics:
    """The methods of a Mechanics that MountedPad calls."""

    def __init__(self, drag: Drag) -> None:
        self._drag = drag
        self.largest_force_n = drag.largest_force_n

    def response(self, x_m: Array, y_m: Array, force_n: Array, *shear_n: Array) -> Array:
        return self._drag.displace(x_m)
