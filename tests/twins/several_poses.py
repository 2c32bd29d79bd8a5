"""The magnets' poses of a pad with several: from the fingers, from the field alone, and across a valley of χ².

Not a witness: it was the daemon's own NumPy, and holds C to the last bit. tests/oracle/test_several.py judges both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import SingularError, cholesky, inverse, product, solve, solve_lower
from fmfts.pose.magnets import CHANGE
from fmfts.several import fit as search
from fmfts.several.field_model import FINGER, FieldModel, Predicted
from fmfts.several.fit import Fit, Fitter
from fmfts.several.free_poses import FARTHEST, FreePoses, at
from fmfts.several.measured import Measured
from fmfts.several.poses import UNFELT, Poses
from fmfts.several.valley import LEAST_FORCE_N, SIDES, STEPS
from fmfts_lab.bench.several_moves import by_finger, considered_moves

Array = NDArray[np.float64]


def poses_in_numpy(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array) -> Poses:
    """As several.poses.poses_of."""
    model, used = fitter.model, measured.used
    predicted = model.predict(fit.fingers)
    change = predicted.change
    moves = np.diag(np.tile(UNFELT, len(change) // CHANGE))
    told = left = np.zeros((len(moves), 0))
    if len(fit.fingers):
        root, poses = fitter.whitener(fit.fingers, measured, around_t), len(change)
        white = solve_lower(root, np.column_stack([predicted.by_pose, predicted.slope, fit.misfit_t])[used])
        considered = considered_moves(model, fit.fingers, predicted)
        # Of what is considered: B (L⁻¹ P B)', with C = L L'.
        told = product(considered, product(white[:, :poses], considered).T)
        change = change + product(told, white[:, -1])
        left = by_finger(model, predicted) - product(told, white[:, poses:-1])
        moves = np.concatenate([moves, considered], axis=1)
    own = square(moves).sum(axis=1) - square(told).sum(axis=1)
    variance = np.maximum(own + (product(left, fit.covariance) * left).sum(axis=1), 0.0)
    magnets = model.mounting.magnets.changed(change, model.mounting.frames)
    return Poses(magnets, change, variance, moves, told, left, fit.covariance)


def across_in_numpy(
    fitter: Fitter, fit: Fit, away: Array, directions: Array, measured: Measured, around_t: Array
) -> tuple[Array, Array]:
    """As several.valley.fitted_across."""
    root = fitter.whitener(fit.fingers, measured, around_t)
    there, chi2 = [], []
    for step, direction in zip(away, directions, strict=True):
        for side in SIDES:
            fingers, told = _on_the_table(fitter, fit.fingers.ravel() + side * step), np.inf
            try:
                for _ in range(STEPS):
                    fingers = _step_across(fitter, root, fingers, direction, measured)
                told = fitter.chi2_with(root, fingers, measured)
            except SingularError:
                pass  # it is not known there
            there.append(fingers)
            chi2.append(told)
    return np.array(there).reshape(len(away), len(SIDES), *fit.fingers.shape), np.array(chi2).reshape(len(away), -1)


def _step_across(fitter: Fitter, root: Array, fingers: Array, direction: Array, measured: Measured) -> Array:
    """One step of Gauss–Newton that leaves the fingers where they are along `direction`."""
    used, predicted = measured.used, fitter.model.predict(fingers)
    slope = solve_lower(root, predicted.slope[used])
    residual = solve_lower(root, (measured.field_t - predicted.field_t)[used])
    spread = inverse(product(slope.T, slope) + np.diag(np.tile(search.FLOOR, len(fingers))))
    step, along = product(spread, product(slope.T, residual)), product(spread, direction)
    across = product(direction, along)
    moved = fingers
    if across > 0.0:
        moved = _on_the_table(fitter, fingers.ravel() + (step - along * (product(direction, step) / across)))
    if not (across > 0.0 and np.isfinite(moved).all()):
        raise SingularError("a step across a valley leads nowhere")
    return moved


def _on_the_table(fitter: Fitter, fingers: Array) -> Array:
    response = fitter.model.response
    each = fingers.reshape(-1, FINGER)
    place = np.clip(each[:, :2], response.first_mm, response.last_mm)
    return np.column_stack([place, np.maximum(each[:, 2], LEAST_FORCE_N)])


def free_poses_in_numpy(model: FieldModel, start: Array, measured: Measured, around_t: Array) -> FreePoses:
    """As several.free_poses.free_poses."""
    measured.checked("field_t", "variance_t2", start=start, ambient_t=around_t)
    used, farthest = measured.used, np.tile(FARTHEST, len(start) // CHANGE)
    floor = 1.0 / (farthest * farthest)
    change, damping = np.clip(start, -farthest, farthest), search.DAMPING
    predicted = at(model, change)
    root = _root_of_poses(model, predicted, measured, around_t)
    white = solve_lower(root, (measured.field_t - predicted.field_t)[used])
    for _ in range(search.ITERATIONS):
        slope = solve_lower(root, predicted.by_pose[used])
        normal = product(slope.T, slope)
        diagonal = np.diagonal(normal)
        step = solve(normal + np.diag(damping * diagonal + floor), product(slope.T, white))
        trial = np.clip(change + step, -farthest, farthest)
        tried = at(model, trial)
        after = solve_lower(root, (measured.field_t - tried.field_t)[used])
        if product(after, after) > product(white, white) * (1.0 + search.ROUNDING):
            damping *= search.DAMPING_FACTOR
            if damping > search.MOST_DAMPING:
                break
            continue
        small = float(np.abs((trial - change) * np.sqrt(diagonal)).max()) < search.SETTLED
        change, predicted, damping = trial, tried, damping / search.DAMPING_FACTOR
        root = _root_of_poses(model, predicted, measured, around_t)
        white = solve_lower(root, (measured.field_t - predicted.field_t)[used])
        if small:
            break
    slope = solve_lower(root, predicted.by_pose[used])
    covariance = inverse(product(slope.T, slope) + np.diag(floor))
    toward = solve_lower(root, model.by_ambient[used])
    ambient = model.scene.ambient_t * model.scene.ambient_t * product(toward.T, white)
    magnets = model.mounting.magnets.changed(change, model.mounting.frames)
    misfit = measured.field_t - predicted.field_t
    return FreePoses(magnets, change, covariance, float(product(white, white)), misfit, ambient)


def _root_of_poses(model: FieldModel, predicted: Predicted, measured: Measured, around_t: Array) -> Array:
    covariance = model.covariance(np.zeros((0, 3)), predicted, measured.variance_t2, around_t)
    if measured.foreign_t2 is not None:
        covariance = covariance + measured.foreign_t2
    return cholesky(covariance[np.ix_(measured.used, measured.used)])
