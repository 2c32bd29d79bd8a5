"""Pads of other silicone, thickness and finger than the shipped model's, solved by CalculiX: `cast_presses.csv`.

`python -m fmfts_lab.finite_elements.cast_presses` makes that file, with a solver that shares no code with the one
that trained the model. Presses are at the places that were solved, and at their seven mirror images: nothing is
interpolated over the place.
"""

from __future__ import annotations

import csv
from functools import cache
from math import cos, pi, sin
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fmfts.pad import Array
from fmfts_simulation.finger import Touch

PRESSES_PATH = Path(__file__).with_name("cast_presses.csv")
POISSON, SOFTER_POISSON = 0.49, 0.47  # solved; the first is the shipped model's
SI = np.array([1e-6, 1e-6, 1e-6, 1.0, 1.0])
HOLD_S, RAMP_S = 0.7, 0.2  # pauses are as long as the press before them
FORCES_N = (0.25, 1.4)


class Ramp(NamedTuple):
    """A press that grows: its place (m), its shear as a share of the force, and the magnet's movement (5,) as a
    polynomial of the force: powers (4, 5) from the first to the fourth."""

    place_m: tuple[float, float]
    shear_share: tuple[float, float]
    powers: Array

    def mirrored(self, turned: bool, along_x: float, along_y: float) -> Ramp:
        def vector(first: float, second: float) -> tuple[float, float]:
            x, y = (second, first) if turned else (first, second)
            return along_x * x, along_y * y

        order = [1, 0, 2, 4, 3] if turned else [0, 1, 2, 3, 4]
        sign = np.array([along_x, along_y, 1.0, along_x, along_y])
        return Ramp(vector(*self.place_m), vector(*self.shear_share), sign * self.powers[:, order])


class CastPad(NamedTuple):
    """poisson: of its silicone; one of those that were solved, or any between and up to incompressible silicone."""

    thickness_mm: float
    finger_mm: float
    poisson: float = POISSON


DRAWN = CastPad(4.0, 6.0)
Presses = dict[tuple[float, float, float, float], Array]  # by place and share of shear: a row for each force


@cache
def solved() -> dict[CastPad, Presses]:
    """Forces (N) and the magnet's movements (µm, axis) of each ramp."""
    rows: dict[tuple[float, ...], list[list[float]]] = {}
    with PRESSES_PATH.open(newline="") as lines:
        for row in csv.DictReader(lines):
            numbers = [float(value) for value in row.values()]
            rows.setdefault(tuple(numbers[:7]), []).append(numbers[7:])
    found: dict[CastPad, Presses] = {}
    for (thickness, finger, poisson, x, y, *shear), levels in rows.items():
        found.setdefault(CastPad(thickness, finger, poisson), {})[x, y, shear[0], shear[1]] = np.array(levels)
    return found


def unsheared_pads() -> list[CastPad]:
    """The pads of the model's own Poisson's ratio that are solved at every place without shear."""
    places = len(_unsheared(DRAWN))
    return [cast for cast in solved() if cast.poisson == POISSON and len(_unsheared(cast)) == places]


def _unsheared(cast: CastPad) -> Presses:
    return {key: levels for key, levels in solved().get(cast, {}).items() if not any(key[2:])}


@cache
def ramps(cast: CastPad, sheared: bool) -> tuple[Ramp, ...]:
    """All presses of such a pad, and their mirror images."""
    found = []
    for (x, y, *shear), table in _with_poisson(cast).items():
        if any(shear) == sheared:
            powers = np.linalg.solve(table[:, :1] ** np.arange(1, len(table) + 1), table[:, 1:] * SI)
            found.append(Ramp((x * 1e-3, y * 1e-3), (shear[0], shear[1]), powers))
    return tuple(
        one.mirrored(turned, along_x, along_y)
        for one in found
        for turned in (False, True)
        for along_x in (1.0, -1.0)
        for along_y in (1.0, -1.0)
    )


def _with_poisson(cast: CastPad) -> Presses:
    """Movements are linear in Poisson's ratio: `finite_elements.poisson`. Where the other ratio is not solved on this
    pad, movements at this place change by the same shares as on DRAWN; on the others, sinking by 0.4 % more or less."""
    if cast.poisson == POISSON:
        return solved()[cast]
    share = (cast.poisson - POISSON) / (SOFTER_POISSON - POISSON)
    changed = {}
    for key, levels in _unsheared(cast._replace(poisson=POISSON)).items():
        by = cast if key in solved().get(cast._replace(poisson=SOFTER_POISSON), {}) else DRAWN
        usual, softer = (solved()[by._replace(poisson=each)][key] for each in (POISSON, SOFTER_POISSON))
        changed[key] = levels * (1.0 + share * (softer / usual - 1.0))
    return changed


class CastMechanics:
    """Stands for a simulated pad's `Mechanics`: only its own presses move the magnet. modulus: over the model's."""

    def __init__(self, solved: tuple[Ramp, ...], modulus: float) -> None:
        self._powers = {_key(*one.place_m, *one.shear_share): one.powers for one in solved}
        self._modulus = modulus

    def response(self, x_m: Array, y_m: Array, force_n: Array, *shear_n: Array) -> Array:
        """(K, 5) as `Mechanics.response`. A higher modulus needs proportionally more force for the same movement."""
        moved = np.zeros((len(force_n), 5))
        pressed = np.flatnonzero(force_n > 0.0)
        shares = [one[pressed] / force_n[pressed] for one in shear_n] or [np.zeros(len(pressed))] * 2
        columns = (x_m[pressed], y_m[pressed], *shares)
        keys = [_key(*one) for one in zip(*(column.tolist() for column in columns), strict=True)]
        for key in set(keys) & self._powers.keys():
            own, powers = pressed[[one == key for one in keys]], self._powers[key]
            moved[own] = (force_n[own, None] / self._modulus) ** np.arange(1, len(powers) + 1) @ powers
        return moved


class CastFinger:
    """A Finger: presses of one of the ramps, each with a force of its own."""

    def __init__(self, solved: tuple[Ramp, ...], largest_n: float, random: np.random.Generator) -> None:
        forces_n = random.uniform(FORCES_N[0], min(FORCES_N[1], largest_n), 64)
        self._presses = [
            (solved[n], force)
            for n, force in zip(random.integers(len(solved), size=64), forces_n.tolist(), strict=True)
        ]

    def __call__(self, time_s: float) -> Touch:
        cycle, within = divmod(time_s / HOLD_S, 2.0)
        solved, force_n = self._presses[int(cycle) % len(self._presses)]
        rise = min(max(min((within - 1.0), (2.0 - within)) * HOLD_S / RAMP_S, 0.0), 1.0)
        force_n *= rise
        (x_m, y_m), (along_x, along_y) = solved.place_m, solved.shear_share
        return Touch(x_m, y_m, force_n, force_n * along_x, force_n * along_y)


def tilted_by(tilt_deg: float, towards_rad: float) -> Array:
    """(3, 3) rotation that tilts by `tilt_deg` about a horizontal axis."""
    x, y, angle = -sin(towards_rad), cos(towards_rad), tilt_deg * pi / 180.0
    cross = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sin(angle) * cross + (1.0 - cos(angle)) * cross @ cross)


def _key(x_m: float, y_m: float, shear_x: float, shear_y: float) -> tuple[int, ...]:
    return round(x_m * 1e7), round(y_m * 1e7), round(shear_x * 1e4), round(shear_y * 1e4)
