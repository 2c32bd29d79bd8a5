"""Poses by the field alone, on pads with two to four magnets over eight to sixteen sensors; for `--free-poses`.

Each frame is by itself, pressed by up to three fingers of any kind, and solved from rest. Then one axis of one sensor
reads too much, and a magnet lies beside the pad: how often is that noticed, and what is published otherwise?
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError
from fmfts.pad import Array
from fmfts.pose.magnets import CHANGE
from fmfts.pose.observable import taken_values
from fmfts.several.free_poses import FARTHEST, FreePoses, free_poses, is_explained
from fmfts.several.measured import Measured
from fmfts_lab.bench.several_layouts import LAYOUTS
from fmfts_lab.bench.several_world import BUILT, BY_HAND, EXACT, World, any_press, world

NOTHING = np.zeros(3)
FRAMES_OF_A_PAD, WRONG = 10, 5.0
AXIS_T = (4e-6, 40e-6)
BESIDE_M, MOMENT_A_M2 = (0.04, 0.06, 0.08), 0.2


@dataclass(slots=True)
class Noticed:
    """Frames with a defect: how many are refused, and how many publish wrong poses."""

    frames: int = 0
    refused: int = 0
    wrong: int = 0

    def add(self, poses: FreePoses | None, used: NDArray[np.bool_], change: Array) -> None:
        self.frames += 1
        if poses is None or not is_explained(poses, used):
            self.refused += 1
        else:
            self.wrong += off(poses, change) > WRONG

    @property
    def told(self) -> str:
        return f"{self.refused / self.frames:.1%}, {self.wrong}"


@dataclass(slots=True)
class Row:
    """The results of one kind of pad."""

    frames: int = 0
    explained: int = 0
    worst: float = 0.0
    wrong: int = 0
    squares: list[float] = field(default_factory=list)
    axis: list[Noticed] = field(default_factory=lambda: [Noticed() for _ in AXIS_T])
    beside: list[Noticed] = field(default_factory=lambda: [Noticed() for _ in BESIDE_M])


def run(options: Namespace) -> None:
    print(
        "| magnets over sensors | values to spare | built | explained | place, rms µm | worst, deviations | wrong "
        f"| an axis reads {AXIS_T[0] * 1e6:g} µT too much: refused, wrong | {AXIS_T[1] * 1e6:g} µT "
        f"| {MOMENT_A_M2:g} A·m² beside, {', '.join(f'{one * 1e3:g}' for one in BESIDE_M)} mm: refused, wrong |\n"
        f"| {' | '.join(['---'] * 10)} |"
    )
    for name, layout in LAYOUTS.items():
        spare = 3 * len(layout.geometry.sensors_mm) - taken_values(1 + len(layout.other_magnets))
        for built, tolerance in (("as drawn", EXACT), ("as built", BUILT), ("by hand", BY_HAND)):
            row = Row()
            for number in range(-(-options.frames // FRAMES_OF_A_PAD)):
                one = world(1000 * options.seed + number, tolerance, layout=layout)
                for frame in range(FRAMES_OF_A_PAD):
                    _frame(row, one, frame % 4)
            axis, beside = ([each.told for each in some] for some in (row.axis, row.beside))
            print(
                f"| {name} | {spare} | {built} | {row.explained / row.frames:.1%} of {row.frames:,} "
                f"| {1e6 * np.sqrt(np.mean(row.squares)):.1f} | {row.worst:.1f} | {row.wrong} "
                f"| {' | '.join(axis)} | {'; '.join(beside)} |",
                flush=True,
            )


def _frame(row: Row, one: World, fingers: int) -> None:
    change = one.pressed([any_press(one.random) for _ in range(fingers)])
    measured = one.measured(change)
    used = measured.used.reshape(-1, 3)
    if (np.abs(change.reshape(-1, CHANGE)) > 0.9 * FARTHEST).any():
        return  # three hard presses beside one magnet: beyond the range of the search
    poses = _solved(one, np.zeros(len(change)), measured)
    row.frames += 1
    if poses is None or not is_explained(poses, used):
        return
    row.explained += 1
    deviations = off(poses, change)
    row.worst, row.wrong = max(row.worst, deviations), row.wrong + (deviations > WRONG)
    row.squares.append(float(np.mean(np.square((poses.change - change).reshape(-1, CHANGE)[:, :3]))))
    for wrong_t, noticed in zip(AXIS_T, row.axis, strict=True):
        there = measured.field_t.copy()
        there[int(one.random.integers(len(there)))] += wrong_t
        noticed.add(_solved(one, poses.change, replace(measured, field_t=there)), used, change)
    for away_m, noticed in zip(BESIDE_M, row.beside, strict=True):
        there = measured.field_t + (_beside(one, away_m) / one.mounting.gain).ravel()
        noticed.add(_solved(one, poses.change, replace(measured, field_t=there)), used, change)


def _solved(one: World, start: Array, measured: Measured) -> FreePoses | None:
    try:
        return free_poses(one.fitter.model, start, measured, NOTHING)
    except SingularError:
        return None


def off(poses: FreePoses, change: Array) -> float:
    """The largest error of any number of any pose, in its own deviations."""
    return float(np.abs((poses.change - change) / np.sqrt(poses.variance)).max())


def _beside(one: World, away_m: float) -> Array:
    """(N, 3) what the chips report of a magnet that lies so far from the middle of the pad, above it or beside."""
    where = np.array([0.0, 0.0, 12e-3]) + away_m * _upward(one.random)
    moment, away = MOMENT_A_M2 * _upward(one.random), one.sensors.position_m - where
    far = np.linalg.norm(away, axis=1, keepdims=True)
    field_t = 1e-7 * (3.0 * away * (away @ moment)[:, None] / far**5 - moment / far**3)
    return np.asarray(one.gain * one.sensors.to_sensor(field_t))


def _upward(random: np.random.Generator) -> Array:
    direction = random.standard_normal(3)
    direction[2] = abs(direction[2])
    return np.asarray(direction / np.linalg.norm(direction))
