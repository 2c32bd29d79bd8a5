"""The estimator of several magnets in NumPy: the equations of docs/several.md, each sum in the order of C.

Fingers and their field (FieldModel), and a search from a start (Fitter) and on a grid.

Not a witness: it was the daemon's own, and holds C to the last bit. tests/oracle/test_several.py judges both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, cholesky, inverse, product, solve, solve_lower
from fmfts.contact.array_response import Pressed
from fmfts.pose.magnets import field_and_slope
from fmfts.several import fit as search
from fmfts.several.arrays import finite
from fmfts.several.field_model import FINGER, FieldModel, Predicted
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import Measured
from fmfts.several.scan import APART_MM, LEAST, NEAR_MM, Another, Grid, best_beside
from fmfts_lab.bench.several_moves import moves, response_error

Array = NDArray[np.float64]


class NumPyModel(FieldModel):
    def field_of(self, fingers: Array) -> Array:
        return self.predict(fingers).field_t

    def predict(self, fingers: Array) -> Predicted:
        finite(fingers=fingers)
        if not len(fingers):
            nothing = np.zeros(len(self._si))
            return Predicted(
                np.zeros(len(self.at_rest)), np.zeros((len(self.at_rest), 0)), self._rest_slope, nothing, ()
            )
        pressed = tuple(self.response.pressed(x, y, force) for x, y, force in fingers.tolist())
        change = np.zeros(len(self._si))
        for one in pressed:
            change = change + one.change - _shifted(one, self._off_mm)
        change = change * self._si
        mounting = self.mounting
        moved = mounting.magnets.changed(change, mounting.frames)
        field, by_pose = field_and_slope(moved, mounting.frames, mounting.sensors)
        by_finger = np.concatenate([one.slope for one in pressed], axis=1) * self._si[:, None]
        return Predicted(field.ravel() - self.at_rest, product(by_pose, by_finger), by_pose, change, pressed)

    def by_shear(self, fingers: Array, predicted: Predicted) -> Array:
        """(3N, 2K) what shear of one deviation does to the field, of each finger along x and y."""
        if not len(fingers):
            return np.zeros((len(self.at_rest), 0))
        causes = [
            self.scene.friction * force * one.by_shear
            for (_, _, force), one in zip(fingers.tolist(), predicted.pressed, strict=True)
        ]
        by_shear: Array = product(predicted.by_pose * self._si, np.concatenate(causes, axis=1))
        return by_shear

    def covariance(self, fingers: Array, predicted: Predicted, variance_t2: Array, ambient_t: Array) -> Array:
        scene = self.scene
        columns = [
            scene.ambient_t * self.by_ambient,
            scene.moment * (predicted.field_t + self.at_rest)[:, None],
            self.mounting.errors.at(predicted.change, ambient_t),
        ]
        if len(fingers):
            by_pose = predicted.by_pose * self._si
            columns.append(product(by_pose, moves(self, fingers, predicted)))
            columns.append(by_pose * response_error(self, fingers, predicted))
        factor = np.concatenate(columns, axis=1)
        covariance: Array = product(factor, factor.T)
        covariance[range(len(variance_t2)), range(len(variance_t2))] += variance_t2
        return covariance


def _shifted(one: Pressed, off_mm: Array) -> Array:
    """(5M,) how much more the magnets move in the drawing's places than `off_mm` (M, 2) beside them."""
    slope = one.slope.reshape(len(off_mm), -1, FINGER)
    shifted: Array = (slope[:, :, 0] * off_mm[:, :1] + slope[:, :, 1] * off_mm[:, 1:]).ravel()
    return shifted


class NumPyScan(Grid):
    def __init__(self, model: FieldModel) -> None:
        super().__init__(model)
        apart = self.places[:, None, :2] - self.places[None, :, :2]
        number = np.arange(len(self.places))
        far = (apart * apart).sum(axis=2) >= APART_MM * APART_MM
        self.pairs = np.column_stack(np.where(far & (number[:, None] < number)))

    def best_seconds(
        self, root: Array, finger: Array, predicted: Predicted, measured: Measured, most: int
    ) -> list[Array]:
        return best_beside(finger, self.another(root, finger, predicted, measured), most)

    def best_single(self, root: Array, measured: Measured) -> tuple[Array, float]:
        """The best finger (1, 3), and by how much it lowers χ²."""
        templates, white = self.white(root, measured)
        along = product(templates, white)
        size = product(templates[:, None, :], templates[:, :, None])[:, 0, 0]
        size = np.where(size > 0.0, size, 1.0)
        gain = np.where(along > 0.0, along * along / size, 0.0)
        best = int(np.argmax(gain))
        place = self.places[best].copy()
        place[2] *= along[best] / size[best]
        return place[None], float(gain[best])

    def best_pairs(self, root: Array, measured: Measured, most: int) -> list[Array]:
        """The best pairs of fingers (2, 3), at different places, the best first."""
        templates, white = self.white(root, measured)
        along, gram = product(templates, white), product(templates, templates.T)
        one, other = self.pairs.T
        size = np.diagonal(gram)
        cross = gram[one, other]
        determinant = size[one] * size[other] - cross * cross
        first = along[one] * size[other] - along[other] * cross
        second = along[other] * size[one] - along[one] * cross
        good = (first > 0.0) & (second > 0.0) & (determinant > 0.0)
        whole = np.where(good, determinant, 1.0)
        gain = np.where(good, (first * along[one] + second * along[other]) / whole, 0.0)
        starts: list[Array] = []
        for best in np.argsort(-gain, kind="stable"):
            if gain[best] <= 0.0 or len(starts) == most:
                break
            pair = self.places[[one[best], other[best]]].copy()
            pair[:, 2] *= first[best] / whole[best], second[best] / whole[best]
            if all(np.abs(pair[:, :2] - known[:, :2]).max() > NEAR_MM for known in starts):
                starts.append(pair)
        return starts

    def another(self, root: Array, fingers: Array, predicted: Predicted, measured: Measured) -> Another:
        """One more finger at each place of the grid beside `fingers` (K, 3), which may move a little for it."""
        templates, _ = self.white(root, measured)
        used = measured.used
        white = solve_lower(root, (measured.field_t - predicted.field_t)[used])
        slope = solve_lower(root, predicted.slope[used])
        # What a small move of the others explains as well is no sign of one more.
        both = np.column_stack([templates.T, white])
        normal = product(slope.T, slope) + LEAST * np.eye(slope.shape[1])
        moved = solve(normal, product(slope.T, both))
        left = both - product(slope, moved)
        along, size = product(left[:, :-1].T, left[:, -1]), (left[:, :-1] * left[:, :-1]).sum(axis=0)
        size = np.where(size > 0.0, size, 1.0)
        gain = np.where((along > 0.0) & self.apart_from(fingers), along * along / size, 0.0)
        return Another(self.places, gain, along / size, moved[:, :-1])


class NumPyFitter(Fitter):
    def __init__(self, model: FieldModel) -> None:
        super().__init__(model)
        self._scan = NumPyScan(model)  # type: ignore[assignment]

    def whitener(self, fingers: Array, measured: Measured, ambient_t: Array) -> Array:
        measured.checked("variance_t2", fingers=fingers, ambient_t=ambient_t)
        return self._root(fingers, self.model.predict(fingers), measured, ambient_t)

    def chi2_with(self, root: Array, fingers: Array, measured: Measured) -> float:
        measured.checked("field_t", root=root, fingers=fingers)
        residual = (measured.field_t - self.model.predict(fingers).field_t)[measured.used]
        white = solve_lower(root, residual)
        return float(product(white, white))

    def fit(self, start: Array, measured: Measured, ambient_t: Array, few_iterations: bool = False) -> Fit:
        measured.checked("field_t", "variance_t2", start=start, ambient_t=ambient_t)
        fingers, used = np.clip(start, self._lowest, self._highest), measured.used
        predicted = self.model.predict(fingers)
        root = self._root(fingers, predicted, measured, ambient_t)
        damping, white = search.DAMPING, solve_lower(root, (measured.field_t - predicted.field_t)[used])
        floor = np.tile(search.FLOOR, len(fingers))
        most = search.FEW_ITERATIONS if few_iterations else search.ITERATIONS
        for _ in range(most if len(fingers) else 0):
            slope = solve_lower(root, predicted.slope[used])
            normal = product(slope.T, slope)
            diagonal = np.diagonal(normal)
            step = solve(normal + np.diag(damping * diagonal + floor), product(slope.T, white))
            if not np.isfinite(step).all():
                raise SingularError(f"a matrix of {len(step)} × {len(step)} is not finite")
            step = step.reshape(-1, FINGER)
            longest = np.abs(step[:, :2]).max()
            step *= min(1.0, search.LONGEST_STEP_MM / max(float(longest), search.LEAST_STEP_MM))
            trial = np.clip(fingers + step, self._lowest, self._highest)
            tried = self.model.predict(trial)
            after = solve_lower(root, (measured.field_t - tried.field_t)[used])
            if product(after, after) > product(white, white) * (1.0 + search.ROUNDING):
                damping *= search.DAMPING_FACTOR
                if damping > search.MOST_DAMPING:
                    break
                continue
            small = float(np.abs((trial - fingers).ravel() * np.sqrt(diagonal)).max()) < search.SETTLED
            fingers, predicted, damping = trial, tried, damping / search.DAMPING_FACTOR
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
            covariance = inverse(normal + np.diag(np.tile(search.FLOOR, len(fingers))))
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
        """The shear (K, 2) of each finger and its deviation.

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
