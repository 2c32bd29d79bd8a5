"""Tries fingers on a grid: all places, and all pairs of places.

A finger's effect on the field is almost proportional to its force. So each place has one template, the field of a
press of 1 N, and the best forces at given places follow from least squares. With templates t and a field f that are
white (L⁻¹·t, L⁻¹·f), a = t·f and s = t·t, one finger lowers χ² by a²/s. For two, with c = t₁·t₂:

    d = s₁s₂ − c²,  first = (a₁s₂ − a₂c)/d,  second = (a₂s₁ − a₁c)/d,  gain = first·a₁ + second·a₂
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import solve_lower
from fmfts.several import _several
from fmfts.several.arrays import doubles, require_room
from fmfts.several.field_model import FieldModel
from fmfts.several.measured import Measured, refuse

Array = NDArray[np.float64]

GRID_MM = 2.0
GRID_FORCE_N = 1.0
APART_MM = 8.0  # nearer fingers count as one: a wide patch looks the same
STARTS = 3  # number of best pairs that are followed to their minimum
LEAST = 1e-9  # the normal matrix of a finger without force, whose place has no effect
NEAR_MM = 1.5 * GRID_MM  # a pair within this distance of a better one leads to the same minimum


class Another(NamedTuple):
    """One more finger at each of G places beside K others. places (G, 3). gain (G,): by how much it lowers χ² at most;
    0 if it would pull, or is too near. force (G,): its own. by_force (3K, G): how far a newton of it moves the others,
    with the opposite sign."""

    places: Array
    gain: Array
    force: Array
    by_force: Array


class Grid:
    """The grid of one mounted pad. places (G, 3): x, y in mm, and the force. templates (G, 3N)."""

    def __init__(self, model: FieldModel) -> None:
        response = model.response
        along = np.arange(response.first_mm, response.last_mm + GRID_MM / 2.0, GRID_MM)
        self.places = np.array([[x, y, GRID_FORCE_N] for x in along for y in along])
        self.templates = np.array([model.predict(place[None]).field_t for place in self.places])
        require_room(places=len(self.places))

    def packed(self) -> tuple[Array, Array]:
        """Places and templates as fit.h has them, and room for a scan."""
        missing = -len(self.places) % _several.PANEL
        places = np.concatenate([self.places[:, :2].T, np.zeros((2, missing))], axis=1)
        templates = np.concatenate([self.templates, np.zeros((missing, self.templates.shape[1]))])
        panels = templates.reshape(-1, _several.PANEL, templates.shape[1]).swapaxes(1, 2)
        room = np.empty((templates.shape[1] + 3) * len(templates))
        return np.concatenate([places.ravel(), panels.ravel()]), room

    def apart_from(self, fingers: Array) -> NDArray[np.bool_]:
        """(G,) which places are not too near to any of `fingers` (K, 3)."""
        apart = self.places[:, None, :2] - fingers[None, :, :2]
        far: NDArray[np.bool_] = ((apart * apart).sum(axis=2) >= APART_MM * APART_MM).all(axis=1)
        return far

    def white(self, root: Array, measured: Measured) -> tuple[Array, Array]:
        """The templates (G, used) and the field (used,), in units of their own errors."""
        measured.checked("field_t", root=root)
        templates = solve_lower(root, np.ascontiguousarray(self.templates[:, measured.used].T)).T
        return templates, solve_lower(root, measured.field_t[measured.used])


def best_beside(finger: Array, another: Another) -> list[Array]:
    """The best pairs (2, 3) of `finger` (1, 3) and another one, at different places, the best first."""
    starts: list[Array] = []
    for best in np.argsort(-another.gain, kind="stable"):
        if another.gain[best] <= 0.0 or len(starts) == STARTS:
            break
        place = another.places[best].copy()
        place[2] *= another.force[best]
        if all(np.abs(place[:2] - known[1, :2]).max() > NEAR_MM for known in starts):
            starts.append(np.stack([finger[0], place]))
    return starts


class Scan:
    """Tries fingers on the grid of one model."""

    def __init__(self, model: FieldModel, search: Array, grid: Grid, room: Array) -> None:
        """search, room: as fit.h has them."""
        self.model, self.search, self.grid = model, search, grid
        self._room = search, model.work, room

    def best_single(self, root: Array, measured: Measured) -> tuple[Array, float]:
        """The best finger (1, 3), and by how much it lowers χ². root: of C without it."""
        found, seen = np.empty((1, 3)), (doubles(root), doubles(measured.field_t), measured.there)
        wrong, size, gain = _several.best_single(*self._room, *seen, found)
        refuse(wrong, size, measured, root=root)
        return found, gain

    def best_pairs(self, root: Array, measured: Measured, most: int = STARTS) -> list[Array]:
        """The best pairs of fingers (2, 3), at different places, the best first."""
        require_room(starts=most)
        found, seen = np.empty((most, 2, 3)), (doubles(root), doubles(measured.field_t), measured.there)
        wrong, size, count = _several.best_pairs(*self._room, *seen, found)
        refuse(wrong, size, measured, root=root)
        return list(found[: int(count)])

    def best_seconds(self, root: Array, finger: Array, measured: Measured) -> list[Array]:
        """The best fingers beside a first one, `finger` (1, 3), which may move a little for each: pairs (2, 3).

        `best_pairs` misses a second finger that is much weaker than the first one, because its template of the first is
        only proportional to force. root: of C at `finger`.
        """
        return best_beside(finger, self.another(root, finger, measured))

    def another(self, root: Array, fingers: Array, measured: Measured) -> Another:
        """One more finger at each place beside `fingers` (K, 3), which may move a little for it."""
        predicted = self.model.predict(fingers)
        found = np.empty((2 + predicted.slope.shape[1], len(self.grid.places)))
        seen = doubles(root), doubles(measured.field_t), measured.there
        wrong, size, _ = _several.another(*self._room, *seen, predicted.field_t, predicted.slope, found)
        refuse(wrong, size, measured, root=root)
        gain = np.where(self.grid.apart_from(fingers), found[0], 0.0)
        return Another(self.grid.places, gain, found[1], found[2:])
