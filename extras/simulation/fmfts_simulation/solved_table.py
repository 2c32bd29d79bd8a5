"""Makes a square pad's table from solved presses: mirrors them, and fits powers of the load at each place of a grid."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fmfts.pad import Array
from fmfts_simulation.mechanics import Mechanics

COLUMNS = ("x_mm", "y_mm", "force_n", "shear_x_n", "shear_y_n", "dx_um", "dy_um", "dz_um", "axis_x", "axis_y")
PRESS, RESPONSE = slice(0, 5), slice(5, 10)
PLANAR = ((0, 1), (3, 4), (5, 6), (8, 9))  # pairs of columns that are vectors in the plane
SI = np.array([1e-6, 1e-6, 1e-6, 1.0, 1.0])
# Exponents of (F, Ft_x, Ft_y) in the terms that shear adds to the response.
SHEAR_EXPONENTS = np.array(
    [(of_force, *linear) for of_force in range(3) for linear in ((1, 0), (0, 1))]
    + [(of_force, *quadratic) for of_force in range(2) for quadratic in ((2, 0), (1, 1), (0, 2))],
    dtype=np.intp,
)

PRESSED_PATH, CENTRE_PATH, SHEARED_PATH = (
    Path(__file__).with_name(f"{name}.csv") for name in ("pressed", "pressed_centre", "sheared")
)


def read_solved(path: Path) -> Array:
    """(K, 10) rows in the order of COLUMNS. Raises OSError, or ValueError where a column or a number is missing."""
    with path.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    try:
        return np.array([[float(row[name]) for name in COLUMNS] for row in rows]).reshape(-1, len(COLUMNS))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: not a table of solved presses ({type(error).__name__}: {error})") from error


def mirrored(rows: Array) -> Array:
    """The rows under the eight symmetries of a square, each press once, sorted by place, force and shear."""
    copies = []
    for transposed in (False, True):
        for along_x in (1.0, -1.0):
            for along_y in (1.0, -1.0):
                copy = rows.copy()
                for x, y in PLANAR:
                    copy[:, x] = along_x * rows[:, y if transposed else x]
                    copy[:, y] = along_y * rows[:, x if transposed else y]
                copies.append(copy)
    whole = np.concatenate(copies) + 0.0
    _, first = np.unique(np.round(whole[:, PRESS], 6), axis=0, return_index=True)
    return np.asarray(whole[first], dtype=np.float64)


def _values(column: Array) -> Array:
    """Each once, in order. `np.unique` would import numpy.ma, a twentieth of what a daemon computes to start."""
    return np.array(sorted(set(column.tolist())))


def normal_mechanics(octant: Array, centre: Array | None = None) -> Mechanics:
    """The table for loads without shear. octant: rows (K, 10) on an even grid in one octant, with equal forces.

    centre: rows at the same forces on some places of a grid twice as fine. At all other places the finer table repeats
    the coarser one exactly, because its splines are among those of the finer grid.
    """
    rows = mirrored(octant)
    grid_mm, force_n = _values(rows[:, 0]), _values(rows[:, 2])
    shape = (len(grid_mm), len(grid_mm), len(force_n), 5)
    if len(rows) != np.prod(shape[:3]):
        raise ValueError(f"{len(rows)} presses at {len(grid_mm)} × {len(grid_mm)} places and {len(force_n)} forces")
    coarse = Mechanics.from_table(grid_mm * 1e-3, force_n, rows[:, RESPONSE].reshape(shape) * SI)
    if centre is None:
        return coarse
    fine_mm = np.linspace(grid_mm[0], grid_mm[-1], 2 * len(grid_mm) - 1)
    x_mm, y_mm, f_n = (each.ravel() for each in np.meshgrid(fine_mm, fine_mm, force_n, indexing="ij"))
    response = coarse.response(x_mm * 1e-3, y_mm * 1e-3, f_n).reshape(len(fine_mm), len(fine_mm), len(force_n), 5)
    added = mirrored(centre)
    at = tuple(np.searchsorted(axis, added[:, i]) for i, axis in enumerate((fine_mm, fine_mm, force_n)))
    response[at] = added[:, RESPONSE] * SI
    return Mechanics.from_table(fine_mm * 1e-3, force_n, response)


def sheared_mechanics(octant: Array, normal: Mechanics) -> Mechanics:
    """The table of what shear adds to `normal`. octant: rows (K, 10) on an even grid in one octant."""
    rows = mirrored(octant)
    x_m, y_m, force_n, *shear_n = (*(rows[:, :2] * 1e-3).T, *rows[:, 2:5].T)
    added = rows[:, RESPONSE] * SI - normal.response(x_m, y_m, force_n)
    power = np.prod(np.stack([force_n, *shear_n], axis=1)[:, None] ** SHEAR_EXPONENTS, axis=2)
    grid_mm = _values(rows[:, 0])
    terms = np.empty((len(grid_mm), len(grid_mm), len(SHEAR_EXPONENTS), 5))
    for i, x_mm in enumerate(grid_mm):
        for j, y_mm in enumerate(grid_mm):
            here = (rows[:, 0] == x_mm) & (rows[:, 1] == y_mm)
            # A term that symmetry forbids explains none of the mirrored rows: least squares leaves it at zero.
            terms[i, j] = np.linalg.lstsq(power[here], added[here], rcond=1e-9)[0]
    return Mechanics.from_terms(grid_mm * 1e-3, float(force_n.max()), SHEAR_EXPONENTS, terms)


@cache
def standard_mechanics() -> Mechanics:
    """The standard pad's table, made from the presses that ship."""
    normal = normal_mechanics(read_solved(PRESSED_PATH), read_solved(CENTRE_PATH))
    return replace(normal, sheared=sheared_mechanics(read_solved(SHEARED_PATH), normal))
