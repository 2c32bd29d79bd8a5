"""Finds the K fingers that best explain a field: Gauss–Newton in the space of fingers, from a start or from a scan.

χ² has several minima as soon as there are two fingers. So a new finger is not searched from where the residual is
largest, which misses the best one in a fifth of all cases, but from the best of all pairs of places on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, cholesky, inverse, product, solve, solve_lower
from fmfts.common.double_table import DoubleTable, Numbers
from fmfts.several.compiled import _several, doubles, room
from fmfts.several.field_model import FINGER, FieldModel, Predicted
from fmfts.several.measured import Measured, refuse
from fmfts.several.scan import APART_MM, GRID_FORCE_N, GRID_MM, LEAST, NEAR_MM, STARTS, Another, CompiledScan, Scan

__all__ = ["APART_MM", "GRID_FORCE_N", "GRID_MM", "STARTS", "Fit", "Fitter", "Measured"]

Array = NDArray[np.float64]

ITERATIONS = 12
# A fit that begins at the right fingers ends within so many; any other is of no use where this many are asked for.
FEW_ITERATIONS = 3
# A step counts as none when it is below this share of each unknown's deviation.
SETTLED = 0.03
# χ² that is larger by this share is not larger: it is rounding.
ROUNDING = 1e-12
DAMPING, DAMPING_FACTOR, MOST_DAMPING = 1e-4, 10.0, 1e6
LONGEST_STEP_MM, LEAST_STEP_MM = 4.0, 1e-12
# Added to the normal matrix, so that fingers of which the values say nothing stay where they are.
FLOOR = np.array([1e-9, 1e-9, 1e-6])
FARTHEST_LOAD = 3.0  # the search goes so far beyond the table's largest force


@dataclass(frozen=True, slots=True)
class Fit:
    """K fingers (K, 3): x, y in mm and force in N, with covariance (3K, 3K). chi2: of the residual; misfit_t (3N,).

    ambient_t (3,): the change of the ambient field that goes with it. shear_n, shear_deviation_n (K, 2): of each one.
    """

    fingers: Array
    covariance: Array
    chi2: float
    misfit_t: Array
    ambient_t: Array
    shear_n: Array
    shear_deviation_n: Array

    @property
    def deviation(self) -> Array:
        """(K, 3)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)).reshape(-1, FINGER)

    @property
    def force_deviations_n(self) -> list[float]:
        """Of each finger; faster than `deviation`, of which they are the last column."""
        return [sqrt(max(variance, 0.0)) for variance in self.covariance.diagonal()[2::FINGER].tolist()]


class Fitter:
    """Fits fingers to the fields of one mounted pad, in C where the model is, and where there is room for the grid.

    A number that is not finite, of a value that there is, is refused by a ValueError that names it. One Fitter is for
    one thread.
    """

    def __init__(self, model: FieldModel) -> None:
        self.model = model
        response = model.response
        farthest = FARTHEST_LOAD * response.scale_n
        self._lowest = np.array([response.first_mm, response.first_mm, 0.0])
        self._highest = np.array([response.last_mm, response.last_mm, farthest])
        self.reference_scan = Scan(model)
        self.places = self.reference_scan.places
        self.compiled = model.compiled and room(places=len(self.places))
        self._scan: Scan | CompiledScan = self.reference_scan
        if self.compiled:
            grid, scan_room = self.reference_scan.packed()
            self.search, self._short_search = (
                np.concatenate([self._head(iterations).values, grid]) for iterations in (ITERATIONS, FEW_ITERATIONS)
            )
            self._scan = CompiledScan(self.reference_scan, self.search, model.work, scan_room)

    def whitener(self, fingers: Array, measured: Measured, ambient_t: Array) -> Array:
        """The lower triangle of C at `fingers`, for the values that there are."""
        if not (self.compiled and room(fingers=len(fingers))):
            return self.reference_whitener(fingers, measured, ambient_t)
        there = measured.there
        used = int(there.sum())
        root = np.empty((used, used))
        wrong, size, _ = _several.whitener(
            self.model.packed,
            self.model.work,
            doubles(fingers),
            doubles(measured.variance_t2),
            measured.foreign,
            there,
            doubles(ambient_t),
            root,
        )
        refuse(wrong, size, measured, fingers=fingers, ambient_t=ambient_t)
        return root

    def chi2_with(self, root: Array, fingers: Array, measured: Measured) -> float:
        """χ² of `fingers` under another covariance, whose lower triangle is `root`."""
        if not (self.compiled and room(fingers=len(fingers))):
            return self.reference_chi2_with(root, fingers, measured)
        wrong, size, chi2 = _several.chi2_with(
            self.model.packed,
            self.model.work,
            doubles(root),
            doubles(fingers),
            doubles(measured.field_t),
            measured.there,
        )
        refuse(wrong, size, measured, root=root, fingers=fingers)
        return chi2

    def fit(self, start: Array, measured: Measured, ambient_t: Array, few_iterations: bool = False) -> Fit:
        """The most likely fingers near `start` (K, 3). SingularError where the values do not determine them.

        few_iterations: to see soon whether they are near it, FEW_ITERATIONS in place of ITERATIONS.
        """
        if not (self.compiled and room(fingers=len(start))):
            return self.reference_fit(start, measured, ambient_t, few_iterations)
        unknowns, values = FINGER * len(start), len(measured.field_t)
        fingers, covariance = np.empty((len(start), FINGER)), np.empty((unknowns, unknowns))
        misfit, ambient = np.empty(values), np.empty(3)
        shear, shear_deviation = np.empty((len(start), 2)), np.empty((len(start), 2))
        wrong, size, chi2 = _several.fit(
            self.model.packed,
            self.model.work,
            self._short_search if few_iterations else self.search,
            doubles(start),
            doubles(measured.field_t),
            doubles(measured.variance_t2),
            measured.foreign,
            measured.there,
            doubles(ambient_t),
            fingers,
            covariance,
            misfit,
            ambient,
            shear,
            shear_deviation,
        )
        refuse(wrong, size, measured, start=start, ambient_t=ambient_t)
        return Fit(fingers, covariance, chi2, misfit, ambient, shear, shear_deviation)

    def best_single(self, root: Array, measured: Measured) -> tuple[Array, float]:
        """The best finger (1, 3) of the grid, and by how much it lowers χ². root: of C without it."""
        return self._scan.best_single(root, measured)

    def best_pairs(self, root: Array, measured: Measured, most: int = STARTS) -> list[Array]:
        """The best pairs of fingers (2, 3) of the grid, at different places, the best first."""
        return self._scan.best_pairs(root, measured, most)

    def best_seconds(self, root: Array, one: Fit, measured: Measured, most: int = STARTS) -> list[Array]:
        """The best fingers of the grid beside `one`, as pairs (2, 3), the best first. root: of C at `one`."""
        return self._scan.best_seconds(root, one.fingers, self.model.predict(one.fingers), measured, most)

    def another(self, root: Array, fit: Fit, measured: Measured) -> Another:
        """One more finger, anywhere beside those of `fit`. root: of C at `fit`."""
        return self._scan.another(root, fit.fingers, self.model.predict(fit.fingers), measured)

    def sizes(self, root: Array, measured: Measured) -> Array:
        """(places,) by how much a finger of 1 N at each place of the grid would raise χ²."""
        templates, _ = self.reference_scan.white(root, measured)
        size: Array = (templates * templates).sum(axis=1)
        return size

    def reference_whitener(self, fingers: Array, measured: Measured, ambient_t: Array) -> Array:
        """whitener() in NumPy."""
        measured.checked("variance_t2", fingers=fingers, ambient_t=ambient_t)
        return self._root(fingers, self.model.predict(fingers), measured, ambient_t)

    def reference_chi2_with(self, root: Array, fingers: Array, measured: Measured) -> float:
        """chi2_with() in NumPy."""
        measured.checked("field_t", root=root, fingers=fingers)
        residual = (measured.field_t - self.model.predict(fingers).field_t)[measured.used]
        white = solve_lower(root, residual)
        return float(product(white, white))

    def reference_fit(self, start: Array, measured: Measured, ambient_t: Array, few_iterations: bool = False) -> Fit:
        """fit() in NumPy."""
        measured.checked("field_t", "variance_t2", start=start, ambient_t=ambient_t)
        fingers, used = np.clip(start, self._lowest, self._highest), measured.used
        predicted = self.model.predict(fingers)
        root = self._root(fingers, predicted, measured, ambient_t)
        damping, white = DAMPING, solve_lower(root, (measured.field_t - predicted.field_t)[used])
        floor = np.tile(FLOOR, len(fingers))
        most = FEW_ITERATIONS if few_iterations else ITERATIONS
        for _ in range(most if len(fingers) else 0):
            slope = solve_lower(root, predicted.slope[used])
            normal = product(slope.T, slope)
            diagonal = np.diagonal(normal)
            step = solve(normal + np.diag(damping * diagonal + floor), product(slope.T, white))
            if not np.isfinite(step).all():
                raise SingularError(f"a matrix of {len(step)} × {len(step)} is not finite")
            step = step.reshape(-1, FINGER)
            longest = np.abs(step[:, :2]).max()
            step *= min(1.0, LONGEST_STEP_MM / max(float(longest), LEAST_STEP_MM))
            trial = np.clip(fingers + step, self._lowest, self._highest)
            tried = self.model.predict(trial)
            after = solve_lower(root, (measured.field_t - tried.field_t)[used])
            if product(after, after) > product(white, white) * (1.0 + ROUNDING):
                damping *= DAMPING_FACTOR
                if damping > MOST_DAMPING:
                    break
                continue
            small = float(np.abs((trial - fingers).ravel() * np.sqrt(diagonal)).max()) < SETTLED
            fingers, predicted, damping = trial, tried, damping / DAMPING_FACTOR
            # The covariance goes with the forces; near the end it stays.
            root = self._root(fingers, predicted, measured, ambient_t)
            white = solve_lower(root, (measured.field_t - predicted.field_t)[used])
            if small:
                break
        return self._told(fingers, predicted, root, measured)

    def _root(self, fingers: Array, predicted: Predicted, measured: Measured, ambient_t: Array) -> Array:
        covariance = self.model.covariance(fingers, predicted, measured.variance_t2, ambient_t)
        if measured.foreign_t2 is not None:
            covariance = covariance + measured.foreign_t2
        return cholesky(covariance[np.ix_(measured.used, measured.used)])

    def _told(self, fingers: Array, predicted: Predicted, root: Array, measured: Measured) -> Fit:
        """root: of the covariance at the fingers themselves, and what is predicted there."""
        used = measured.used
        residual = measured.field_t - predicted.field_t
        white, slope = solve_lower(root, residual[used]), solve_lower(root, predicted.slope[used])
        normal = product(slope.T, slope)
        try:
            covariance = inverse(normal + np.diag(np.tile(FLOOR, len(fingers))))
        except SingularError:
            covariance = np.full(normal.shape, np.inf)
        # The most likely ambient field, given the residual: σ² A' C⁻¹ r.
        toward = solve_lower(root, self.model.by_ambient[used])
        ambient = self.model.scene.ambient_t * self.model.scene.ambient_t * product(toward.T, white)
        by_shear = solve_lower(root, self.model.by_shear(fingers, predicted)[used])
        shear = self._shear_of(fingers, covariance, by_shear, white, slope)
        return Fit(fingers, covariance, float(product(white, white)), residual, ambient, *shear)

    def _shear_of(
        self, fingers: Array, covariance: Array, by_shear: Array, white: Array, slope: Array
    ) -> tuple[Array, Array]:
        """The shear (K, 2) of each finger and its deviation. shear.c does the same.

        Of a considered cause of deviation one, whose effect on the field is g, the residual r tells g'C⁻¹r, with the
        variance 1 − g'C⁻¹g + h'Σh; h = J'C⁻¹g, J and Σ the slope by the fingers and their covariance.
        """
        prior_n = np.repeat(self.model.scene.friction * fingers[:, 2], 2)
        if not np.isfinite(covariance).all():
            return np.zeros((len(fingers), 2)), prior_n.reshape(-1, 2)
        by_finger = product(slope.T, by_shear)
        size = np.diagonal(product(by_shear.T, by_shear))
        spent = np.diagonal(product(by_finger.T, covariance, by_finger))
        share = np.sqrt(np.maximum(1.0 - size + spent, 0.0))
        return (prior_n * product(by_shear.T, white)).reshape(-1, 2), (prior_n * share).reshape(-1, 2)

    def _head(self, iterations: int) -> DoubleTable:
        """The constants of the search, as fit.h has them."""
        head = DoubleTable(_several.SEARCH_HEAD)
        numbers: dict[str, Numbers] = {
            "iterations": iterations,
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
        }
        for name, number in numbers.items():
            head.put(name, number)
        return head
