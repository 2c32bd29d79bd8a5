"""Finds the K fingers that best explain a field: Gauss–Newton in the space of fingers, from a start or from a scan.

χ² has several minima as soon as there are two fingers. So a new finger is not searched from where the residual is
largest, which misses the best one in a fifth of all cases, but from the best of all pairs of places on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, cholesky, inverse, product, solve, solve_lower
from fmfts.several.field_model import FINGER, FieldModel

Array = NDArray[np.float64]

ITERATIONS = 12
# A step counts as none when it is below this share of each unknown's deviation.
SETTLED = 0.03
DAMPING, DAMPING_FACTOR = 1e-4, 10.0
LONGEST_STEP_MM = 4.0
GRID_MM = 2.0  # of the scan
GRID_FORCE_N = 1.0  # of its presses: what a finger does is almost in proportion to its force
APART_MM = 8.0  # fingers that are nearer to each other are one: a wide patch looks the same
STARTS = 3  # so many of the best pairs are followed to their minimum
FARTHEST_LOAD = 3.0  # the search goes so far beyond the table's largest force
SMALLEST_N = 1e-3


@dataclass(frozen=True, slots=True)
class Fit:
    """K fingers (K, 3): x, y in mm and force in N, with covariance (3K, 3K). chi2: of the residual; misfit_t (3N,).

    ambient_t (3,): the change of the ambient field that goes with it.
    """

    fingers: Array
    covariance: Array
    chi2: float
    misfit_t: Array
    ambient_t: Array

    @property
    def deviation(self) -> Array:
        """(K, 3)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)).reshape(-1, FINGER)


@dataclass(frozen=True, slots=True)
class Measured:
    """A field's change since rest (3N,), its variance by noise (3N,), and which values there are (3N,)."""

    field_t: Array
    variance_t2: Array
    used: NDArray[np.bool_]


class Fitter:
    """Fits fingers to the fields of one mounted pad."""

    def __init__(self, model: FieldModel) -> None:
        self.model = model
        response = model.response
        farthest = FARTHEST_LOAD * response.scale_n
        self._lowest = np.array([response.first_mm, response.first_mm, 0.0])
        self._highest = np.array([response.last_mm, response.last_mm, farthest])
        along = np.arange(response.first_mm, response.last_mm + GRID_MM / 2.0, GRID_MM)
        self.places = np.array([[x, y, GRID_FORCE_N] for x in along for y in along])
        self._templates = np.array([model.predict(place[None]).field_t for place in self.places])
        apart = self.places[:, None, :2] - self.places[None, :, :2]
        number = np.arange(len(self.places))
        far = (apart * apart).sum(axis=2) >= APART_MM * APART_MM
        self._pairs = np.column_stack(np.where(far & (number[:, None] < number)))

    def whitener(self, fingers: Array, measured: Measured, ambient_t: Array) -> Array:
        """The lower triangle of C at `fingers`, for the values that there are."""
        predicted = self.model.predict(fingers)
        covariance = self.model.covariance(fingers, predicted, measured.variance_t2, ambient_t)
        return cholesky(covariance[np.ix_(measured.used, measured.used)])

    def chi2_with(self, root: Array, fingers: Array, measured: Measured) -> float:
        """χ² of `fingers` under another covariance, whose lower triangle is `root`."""
        residual = (measured.field_t - self.model.predict(fingers).field_t)[measured.used]
        white = solve_lower(root, residual)
        return float(product(white, white))

    def fit(self, start: Array, measured: Measured, ambient_t: Array) -> Fit:
        """The most likely fingers near `start` (K, 3). SingularError where the values do not determine them."""
        fingers = np.clip(start, self._lowest, self._highest)
        used, variance = measured.used, measured.variance_t2
        if not len(fingers):
            return self._told(fingers, measured, ambient_t)
        predicted = self.model.predict(fingers)
        root = cholesky(self.model.covariance(fingers, predicted, variance, ambient_t)[np.ix_(used, used)])
        damping, white = DAMPING, solve_lower(root, (measured.field_t - predicted.field_t)[used])
        for _ in range(ITERATIONS):
            slope = solve_lower(root, predicted.slope[used])
            normal = product(slope.T, slope)
            diagonal = np.diagonal(normal)
            floor = 1e-9 * np.tile([1.0, 1.0, 1e3], len(fingers))
            step = solve(normal + np.diag(damping * diagonal + floor), product(slope.T, white))
            step = step.reshape(-1, FINGER)
            longest = np.abs(step[:, :2]).max()
            step *= min(1.0, LONGEST_STEP_MM / max(float(longest), 1e-12))
            trial = np.clip(fingers + step, self._lowest, self._highest)
            tried = self.model.predict(trial)
            after = solve_lower(root, (measured.field_t - tried.field_t)[used])
            if product(after, after) > product(white, white) * (1.0 + 1e-12):
                damping *= DAMPING_FACTOR
                if damping > 1e6:
                    break
                continue
            small = float(np.abs((trial - fingers).ravel() * np.sqrt(diagonal)).max()) < SETTLED
            fingers, predicted, damping = trial, tried, damping / DAMPING_FACTOR
            # The covariance goes with the forces; near the end it stays.
            root = cholesky(self.model.covariance(fingers, predicted, variance, ambient_t)[np.ix_(used, used)])
            white = solve_lower(root, (measured.field_t - predicted.field_t)[used])
            if small:
                break
        return self._told(fingers, measured, ambient_t)

    def best_single(self, root: Array, measured: Measured) -> tuple[Array, float]:
        """The best finger (1, 3) of the grid, and by how much it lowers χ². root: of C without it."""
        templates, white = self._white(root, measured)
        along = product(templates, white)
        size = (templates * templates).sum(axis=1)
        gain = np.where(along > 0.0, along * along / size, 0.0)
        best = int(np.argmax(gain))
        place = self.places[best].copy()
        place[2] *= along[best] / size[best]
        return place[None], float(gain[best])

    def best_pairs(self, root: Array, measured: Measured, most: int = STARTS) -> list[Array]:
        """The best pairs of fingers (2, 3) of the grid, at different places, the best first."""
        templates, white = self._white(root, measured)
        along, gram = product(templates, white), product(templates, templates.T)
        one, other = self._pairs.T
        size = np.diagonal(gram)
        cross = gram[one, other]
        determinant = size[one] * size[other] - cross * cross
        first = (along[one] * size[other] - along[other] * cross) / determinant
        second = (along[other] * size[one] - along[one] * cross) / determinant
        gain = np.where((first > 0.0) & (second > 0.0), first * along[one] + second * along[other], 0.0)
        starts: list[Array] = []
        for best in np.argsort(-gain, kind="stable"):
            if gain[best] <= 0.0 or len(starts) == most:
                break
            pair = self.places[[one[best], other[best]]].copy()
            pair[:, 2] *= first[best], second[best]
            if all(np.abs(pair[:, :2] - known[:, :2]).max() > 1.5 * GRID_MM for known in starts):
                starts.append(pair)
        return starts

    def best_seconds(self, root: Array, one: Fit, measured: Measured, most: int = STARTS) -> list[Array]:
        """The best fingers of the grid beside `one`, which may move a little for each: pairs (2, 3), the best first.

        A second finger that is much weaker than the first one is lost in `best_pairs`, where the first one's press is
        only as its share of a press of 1 N. root: of C at `one`.
        """
        templates, _ = self._white(root, measured)
        predicted = self.model.predict(one.fingers)
        used = measured.used
        white = solve_lower(root, (measured.field_t - predicted.field_t)[used])
        slope = solve_lower(root, predicted.slope[used])
        # What a small move of the first finger explains as well is no sign of a second one.
        inner = solve(product(slope.T, slope), product(slope.T, np.column_stack([templates.T, white])))
        left = np.column_stack([templates.T, white]) - product(slope, inner)
        templates, white = left[:, :-1].T, left[:, -1]
        along, size = product(templates, white), (templates * templates).sum(axis=1)
        apart = self.places[:, :2] - one.fingers[0, :2]
        far = (apart * apart).sum(axis=1) >= APART_MM * APART_MM
        gain = np.where((along > 0.0) & far, along * along / size, 0.0)
        starts: list[Array] = []
        for best in np.argsort(-gain, kind="stable"):
            if gain[best] <= 0.0 or len(starts) == most:
                break
            place = self.places[best].copy()
            place[2] *= along[best] / size[best]
            if all(np.abs(place[:2] - known[1, :2]).max() > 1.5 * GRID_MM for known in starts):
                starts.append(np.stack([one.fingers[0], place]))
        return starts

    def sizes(self, root: Array, measured: Measured) -> Array:
        """(places,) by how much a finger of 1 N at each place of the grid would raise χ²."""
        templates, _ = self._white(root, measured)
        size: Array = (templates * templates).sum(axis=1)
        return size

    def _white(self, root: Array, measured: Measured) -> tuple[Array, Array]:
        templates = solve_lower(root, np.ascontiguousarray(self._templates[:, measured.used].T)).T
        return templates, solve_lower(root, measured.field_t[measured.used])

    def _told(self, fingers: Array, measured: Measured, ambient_t: Array) -> Fit:
        """With the covariance at the fingers themselves."""
        used = measured.used
        predicted = self.model.predict(fingers)
        whole = self.model.covariance(fingers, predicted, measured.variance_t2, ambient_t)
        root = cholesky(whole[np.ix_(used, used)])
        residual = measured.field_t - predicted.field_t
        white, slope = solve_lower(root, residual[used]), solve_lower(root, predicted.slope[used])
        normal = product(slope.T, slope)
        try:
            covariance = inverse(normal + np.diag(1e-9 * np.tile([1.0, 1.0, 1e3], len(fingers))))
        except SingularError:
            covariance = np.full(normal.shape, np.inf)
        # The most likely ambient field, given the residual: σ² A' C⁻¹ r.
        toward = solve_lower(root, self.model.by_ambient[used])
        ambient = self.model.scene.ambient_t * self.model.scene.ambient_t * product(toward.T, white)
        return Fit(fingers, covariance, float(product(white, white)), residual, ambient)
