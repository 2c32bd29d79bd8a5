"""Finds the K fingers that best explain a field: damped least squares (arithmetic/descent.h), from a start or a scan.

χ² has several minima as soon as there are two fingers. A search from the largest residual misses the best minimum in a
fifth of all cases, so a new finger is searched from the best of all pairs of places on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.common.chi2 import quantile
from fmfts.common.record import Record
from fmfts.pose.observable import FREE_FIELD
from fmfts.several import _several
from fmfts.several.arrays import doubles, require_room
from fmfts.several.field_model import FINGER, FieldModel
from fmfts.several.measured import Measured, refuse
from fmfts.several.scan import APART_MM, GRID_FORCE_N, GRID_MM, LEAST, NEAR_MM, STARTS, Grid, Scan

__all__ = ["APART_MM", "GRID_FORCE_N", "GRID_MM", "STARTS", "Fit", "Fitter", "Measured"]

Array = NDArray[np.float64]

ITERATIONS = 12
# Iterations within which a fit from the right fingers converges; other fits are then useless.
FEW_ITERATIONS = 3
# A step below this share of each unknown's deviation counts as zero.
SETTLED = 0.03
# The covariance under one finger is computed again when the finger is this many deviations from where it was computed:
# less than that changes no published number by a thousandth of its deviation. Two fingers that merge need it each time.
STALE = 0.01
# A relative increase of χ² up to this is rounding.
ROUNDING = 1e-12
DAMPING, DAMPING_FACTOR, MOST_DAMPING = 1e-4, 10.0, 1e6
LONGEST_STEP_MM, LEAST_STEP_MM = 4.0, 1e-12
# Added to the normal matrix, so that undetermined fingers stay where they are.
FLOOR = np.array([1e-9, 1e-9, 1e-6])
FARTHEST_LOAD = 3.0  # limit of the search, as a multiple of the table's largest force
# A finger whose force is less than this many deviations, or two nearer than this, are doubtful (count.py).
RELEASE_DEVIATIONS, TOGETHER_MM = 3.0, 6.5
# Beyond the table's edge, place and force are not known. If a search ends nearer than EDGE_MM to it, the finger may lie
# beyond. A weak finger may end there by noise, so its force must exceed CERTAIN_DEVIATIONS.
EDGE_MM, CERTAIN_DEVIATIONS = 0.5, 6.0
UNDETERMINED, DOUBTFUL, BEYOND = 1, 2, 4  # flags, as fit.h has them


@dataclass(slots=True)
class Fit:
    """K fingers (K, 3): x, y in mm and force in N, with covariance (3K, 3K). chi2: of the residual; misfit_t (3N,).

    ambient_t (3,): the change of the ambient field that goes with it. shear_n, shear_deviation_n (K, 2): of each one.
    noise_t (3N,): what misfit_t most likely has of noise alone. slope_t (3N, 3K): of the predicted field. flags:
    of UNDETERMINED … values: how many it was made from.
    """

    fingers: Array
    covariance: Array
    chi2: float
    misfit_t: Array
    ambient_t: Array
    shear_n: Array
    shear_deviation_n: Array
    noise_t: Array
    slope_t: Array
    flags: int
    values: int

    @classmethod
    def room(cls, count: int, values: int) -> Fit:
        """For C to fill."""
        unknowns, each = FINGER * count, (count, 2)
        shapes = (count, FINGER), (unknowns, unknowns), values, 3, each, each, values, (values, unknowns)
        fingers, covariance, misfit, ambient, shear, shear_deviation, noise, slope = (np.empty(each) for each in shapes)
        return cls(fingers, covariance, 0.0, misfit, ambient, shear, shear_deviation, noise, slope, 0, values)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All as C writes them."""
        shear = self.shear_n, self.shear_deviation_n
        return self.fingers, self.covariance, self.misfit_t, self.ambient_t, *shear, self.noise_t, self.slope_t

    def limit(self, probability: float) -> float:
        """The χ² that a healthy frame exceeds with this probability."""
        return limit(probability, self.values, len(self.fingers))

    @property
    def deviation(self) -> Array:
        """(K, 3)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)).reshape(-1, FINGER)


def limit(probability: float, values: int, fingers: int) -> float:
    """The χ² that a healthy frame of so many values exceeds with this probability."""
    return quantile(probability, max(values - FREE_FIELD - FINGER * fingers, 1))


class Fitter(Scan):
    """Fits fingers to the fields of one mounted pad.

    A present value that is not finite raises a ValueError that names it. One Fitter is for one thread. grid: of another
    Fitter of the pad, in any scene; None: it is made, which takes milliseconds.
    """

    def __init__(self, model: FieldModel, grid: Grid | None = None) -> None:
        response = model.response
        farthest = FARTHEST_LOAD * response.scale_n
        self._lowest = np.array([response.first_mm, response.first_mm, 0.0])
        self._highest = np.array([response.last_mm, response.last_mm, farthest])
        grid = Grid(model) if grid is None else grid
        self.places = grid.places
        packed, scan_room = grid.packed()
        search, self._short_search = (
            np.concatenate([self._head(iterations).flat, packed]) for iterations in (ITERATIONS, FEW_ITERATIONS)
        )
        super().__init__(model, search, grid, scan_room)

    def whitener(self, fingers: Array, measured: Measured, ambient_t: Array) -> Array:
        """The lower triangle of C at `fingers`, for the present values."""
        require_room(fingers=len(fingers))
        used = np.count_nonzero(measured.used)
        root = np.empty((used, used))
        given = doubles(fingers), *measured.arrays[1:], doubles(ambient_t)
        wrong, size, _ = _several.whitener(*self.model.parts, *given, root)
        refuse(wrong, size, measured, fingers=fingers, ambient_t=ambient_t)
        return root

    def chi2_with(self, root: Array, fingers: Array, measured: Measured) -> float:
        """χ² of `fingers` under another covariance, whose lower triangle is `root`."""
        require_room(fingers=len(fingers))
        given = doubles(root), doubles(fingers), doubles(measured.field_t), measured.there
        wrong, size, chi2 = _several.chi2_with(*self.model.parts, *given)
        refuse(wrong, size, measured, root=root, fingers=fingers)
        return chi2

    def fit(self, start: Array, measured: Measured, ambient_t: Array, few_iterations: bool = False) -> Fit:
        """The most likely fingers near `start` (K, 3). SingularError where the values do not determine them.

        few_iterations: a short trial, FEW_ITERATIONS in place of ITERATIONS.
        """
        require_room(fingers=len(start))
        found = Fit.room(len(start), len(measured.field_t))
        search = self._short_search if few_iterations else self.search
        given = doubles(start), *measured.arrays, doubles(ambient_t)
        (wrong, size, found.chi2), found.flags, found.values = _several.fit(
            *self.model.parts, search, *given, *found.arrays
        )
        if wrong is not None:
            refuse(wrong, size, measured, start=start, ambient_t=ambient_t)
        return found

    def sizes(self, root: Array, measured: Measured) -> Array:
        """(places,) by how much a finger of 1 N at each place of the grid would raise χ²."""
        templates, _ = self.grid.white(root, measured)
        size: Array = (templates * templates).sum(axis=1)
        return size

    def _head(self, iterations: int) -> Record:
        """The constants of the search, for fit.h."""
        head = Record(_several.SEARCH_HEAD)
        head.fill(
            {
                "iterations": iterations,
                "stale": STALE,
                "settled": SETTLED,
                "rounding": ROUNDING,
                "damping": DAMPING,
                "damping_factor": DAMPING_FACTOR,
                "most_damping": MOST_DAMPING,
                "longest_step_mm": LONGEST_STEP_MM,
                "least_step_mm": LEAST_STEP_MM,
                "lowest": self._lowest,
                "highest": self._highest,
                "floor": FLOOR,
                "places": len(self.places),
                "force_n": GRID_FORCE_N,
                "apart_mm": APART_MM,
                "near_mm": NEAR_MM,
                "least": LEAST,
                "together_mm": TOGETHER_MM,
                "release_deviations": RELEASE_DEVIATIONS,
                "edge_mm": EDGE_MM,
                "certain_deviations": CERTAIN_DEVIATIONS,
            }
        )
        return head
