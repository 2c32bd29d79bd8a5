"""Makes a table from contact to field of labelled fields: penalised splines, and how far frames are from them.

Where rows of an untouched pad tell its rest, the change of the field from the newest rest is fitted, and no load means
no change. Where none do, the field itself is fitted, and with it what drifts: the moment of all magnets, which warm by
some kelvin within hours (a per cent), and the rest of each sensor, as slow curves over the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.calibrate.field_set import FieldSet, Indices
from fmfts.calibrate.field_table import DataError
from fmfts.contact.field_response import Axis, FieldResponse
from fmfts.pad import Array

Say = Callable[[str], None]
PLACE_SPACING_MM, MOST_CELLS = 2.0, 16
LOAD_CELLS_BESIDE_PLACES, LOAD_CELLS_ALONE = 3, 12
ROUGHNESS = (1e-4, 1e-3, 1e-2, 1e-1)
FOLDS = 4
FEWEST_ROWS = 150
# Rows for each knot of the drift, and rounds in which table and drift are fitted in turn.
DRIFT_ROWS, MOST_DRIFT_KNOTS, ROUNDS = 400, 8, 5
REST_DRIFT_UT, ROW_UT = 15.0, 10.0  # deviations: of a drifting rest, and of one row about the table
# Levels of load with a covariance of their own: each from so many rows for each value of a frame.
ROWS_OF_A_VALUE, MOST_LEVELS = 12, 9
SHRUNK = 0.05  # towards the mean of all levels, because a level has few rows
STEP_UT = 2.0  # of the chip: no value is known better
# From one recording to the next an untouched pad's rest does not say by so much where the field starts from under load:
# a printed pad gives its set of tens of µT back as it is pressed.
REPEATED_UT = 8.0
# Of the moment from frame to frame beside what a stretch of rows tells, where no rest tells it: half a kelvin or two.
MOMENT_SHARE = 0.003
# Two pads of a structure, or two days of one, differ by this in what load makes the same change of the field. eFlesh's
# printed pad softened by 3 % between two recordings six minutes apart; a stage's height of contact is off by 10 %.
LOAD_SHARE = {"depth_mm": 0.1, "force_n": 0.03, "shear_n": 0.03}


class Drift(NamedTuple):
    """Of each row: moment (K,), about zero, and rest_ut (K, P), about zero."""

    moment: Array
    rest_ut: Array


def make_response(data: FieldSet, origin: str, say: Say) -> FieldResponse:
    """The table of the labelled rows. origin: written into the file. DataError where there are too few rows."""
    rests = data.rest_ut()
    has_rest = bool(np.isfinite(rests).all())
    known = data.labelled
    if known.sum() < FEWEST_ROWS:
        raise DataError(f"{origin}: {known.sum()} rows with a contact that is known; a table needs {FEWEST_ROWS}")
    contact, recording = data.contact[known], data.recording[known]
    target = data.field_ut[known] - (rests[known] if has_rest else 0.0)
    axes = _axes(data.axes, contact, has_rest)
    with threadpool_limits(1):  # sums have one order, so that the same rows give the same table
        roughness = _best_roughness(axes, contact, target, recording, has_rest)
        drift = Drift(np.zeros(len(contact)), np.zeros_like(target))
        fit = _Fit(axes, roughness, has_rest)
        coefficient = fit.of(contact, target)
        for _ in range(0 if has_rest else ROUNDS):
            drift = _drift(target, fit.basis(contact) @ coefficient, recording)
            coefficient = fit.of(contact, (target - drift.rest_ut) / (1.0 + drift.moment)[:, None])
        clean = (target - drift.rest_ut) / (1.0 + drift.moment)[:, None]
        left = _left_out(fit, contact, clean)
        levels, covariance = _covariance(contact[:, -1], left, REPEATED_UT if has_rest else STEP_UT)
    say(
        f"{len(contact)} rows, {len(coefficient)} numbers for each value; roughness {roughness:g}; rows that the fit "
        f"was not told are {np.sqrt(np.mean(left**2)):.1f} µT off"
    )
    if not has_rest:
        say(f"no rows of rest: the moment drifted by {np.ptp(drift.moment):.2%} within the set, as fitted")
    shape = (*(axis.cells + 3 for axis in axes), target.shape[1])
    reference = rests[known].mean(axis=0) if has_rest else _at_least_load(fit, contact, coefficient)
    if not has_rest:
        coefficient = coefficient - reference  # the splines of a place sum to one
    return FieldResponse(
        axes,
        reference,
        has_rest,
        coefficient.reshape(shape),
        tuple(levels.tolist()),
        covariance,
        0.0 if has_rest else MOMENT_SHARE,
        LOAD_SHARE[data.axes[-1]],
        origin,
    )


def _axes(names: tuple[str, ...], contact: Array, has_rest: bool) -> tuple[Axis, ...]:
    """Knots over the range of the rows; a load begins at none where the rest is known."""
    axes = []
    for number, name in enumerate(names):
        values = contact[:, number]
        load = number == len(names) - 1
        first, last = float(values.min()), float(values.max())
        if load and has_rest:
            first = min(first, 0.0)
        if not last > first:
            raise DataError(f"column {name} has one value, {first:g}: leave the column out, or press elsewhere, too")
        different = len(np.unique(np.round(values, 2)))
        if load:
            wanted = LOAD_CELLS_ALONE if len(names) == 1 else LOAD_CELLS_BESIDE_PLACES
        else:
            wanted = min(round((last - first) / PLACE_SPACING_MM), MOST_CELLS)
        cells = max(1, min(wanted, different // 2))
        axes.append(Axis(name, first, (last - first) / cells, cells))
    return tuple(axes)


class _Fit:
    """Penalised least squares: third differences of the coefficients along each axis cost `roughness`."""

    def __init__(self, axes: tuple[Axis, ...], roughness: float, anchored: bool) -> None:
        self.axes = axes
        sizes = [axis.cells + 3 for axis in axes]
        self._penalty = roughness * _differences(sizes)
        self._anchor = self.basis(_unloaded(axes)) if anchored else None

    def basis(self, contact: Array) -> Array:
        """(K, numbers)."""
        out = np.ones((len(contact), 1))
        for number, axis in enumerate(self.axes):
            cell, values, _ = axis.stencil(contact[:, number])
            along = np.zeros((len(contact), axis.cells + 3))
            np.put_along_axis(along, cell[:, None] + np.arange(4), values, axis=1)
            out = (out[:, :, None] * along[:, None, :]).reshape(len(contact), -1)
        return out

    def of(self, contact: Array, target: Array) -> Array:
        """(numbers, P)."""
        basis = self.basis(contact)
        normal = basis.T @ basis
        # Relative to the weight of the rows, so that `roughness` does not depend on their number.
        scale = np.trace(normal) / len(normal)
        normal += scale * (self._penalty + 1e-9 * np.eye(len(normal)))
        if self._anchor is not None:
            # No load, no change: rows of the rest, as many as a tenth of the others, each exact to the chip's step.
            normal += (ROW_UT / STEP_UT) ** 2 * 0.1 * len(contact) / len(self._anchor) * self._anchor.T @ self._anchor
        coefficient: Array = scipy.linalg.solve(normal, basis.T @ target, assume_a="pos")
        return coefficient


def _unloaded(axes: tuple[Axis, ...]) -> Array:
    """Contacts without load, all over the places."""
    lines = [axis.first + axis.spacing * np.arange(axis.cells + 1) for axis in axes[:-1]]
    lines.append(np.zeros(1))
    return np.stack([one.ravel() for one in np.meshgrid(*lines, indexing="ij")], axis=1)


def _differences(sizes: list[int]) -> Array:
    """The quadratic form of third differences along each axis."""
    total: Array = np.zeros((int(np.prod(sizes)),) * 2)
    for along in range(len(sizes)):
        form: Array = np.ones((1, 1))
        for axis, size in enumerate(sizes):
            third = np.diff(np.eye(size), 3, axis=0)
            form = np.asarray(np.kron(form, third.T @ third if axis == along else np.eye(size)), dtype=np.float64)
        total += form
    return total


def _best_roughness(axes: tuple[Axis, ...], contact: Array, target: Array, recording: Indices, anchored: bool) -> float:
    """Of ROUGHNESS the one with which left-out rows are nearest to the table, after one look at the drift."""
    if not anchored:
        middle = _Fit(axes, ROUGHNESS[2], anchored)
        drift = _drift(target, middle.basis(contact) @ middle.of(contact, target), recording)
        target = (target - drift.rest_ut) / (1.0 + drift.moment)[:, None]
    squares = [np.mean(_left_out(_Fit(axes, one, anchored), contact, target) ** 2) for one in ROUGHNESS]
    return ROUGHNESS[int(np.argmin(squares))]


def _left_out(fit: _Fit, contact: Array, target: Array) -> Array:
    """(K, P): residuals of rows, each from a fit that was not told it."""
    fold = np.random.default_rng(0).permutation(len(contact)) % FOLDS
    residual = np.empty_like(target)
    for number in range(FOLDS):
        out = fold == number
        residual[out] = target[out] - fit.basis(contact[out]) @ fit.of(contact[~out], target[~out])
    return residual


def _drift(target: Array, table: Array, recording: Indices) -> Drift:
    """Moment and rest over the rows of each recording, from what the table leaves."""
    moment, rest = np.zeros(len(target)), np.zeros_like(target)
    for number in np.unique(recording):
        rows = np.flatnonzero(recording == number)
        knots = int(np.clip(len(rows) // DRIFT_ROWS, 1, MOST_DRIFT_KNOTS))
        time = Axis("row", 0.0, max(len(rows) - 1, 1) / knots, knots)
        curve = _Fit((time,), 0.0, False).basis(np.arange(len(rows), dtype=float)[:, None])
        size = np.einsum("kp,kp->k", table[rows], table[rows])
        share = np.einsum("kp,kp->k", table[rows], target[rows] - table[rows])
        ridge = 1e-9 * size.sum() * np.eye(curve.shape[1])
        moment[rows] = curve @ np.linalg.solve(curve.T @ (size[:, None] * curve) + ridge, curve.T @ share)
        left = target[rows] - (1.0 + moment[rows])[:, None] * table[rows]
        ridge = curve.shape[1] * (ROW_UT / REST_DRIFT_UT) ** 2 * np.eye(curve.shape[1])
        rest[rows] = curve @ np.linalg.solve(curve.T @ curve + ridge, curve.T @ left)
    return Drift(moment - moment.mean(), rest - rest.mean(axis=0))


def _at_least_load(fit: _Fit, contact: Array, coefficient: Array) -> Array:
    """(P,): the table's mean field at the smallest load: from there changes count where no rest was recorded."""
    light = contact.copy()
    light[:, -1] = fit.axes[-1].first
    mean: Array = (fit.basis(light) @ coefficient).mean(axis=0)
    return mean


def _covariance(load: Array, left: Array, least_ut: float) -> tuple[Array, Array]:
    """Levels of load (L,) and the covariance (L, P, P) of left-out rows there. least_ut: each value's own deviation."""
    values = left.shape[1]
    count = int(np.clip(len(left) // (ROWS_OF_A_VALUE * values), 1, MOST_LEVELS))
    floor = least_ut**2 * np.eye(values)
    mean = left.T @ left / len(left)
    if count == 1:
        return np.array([float(np.median(load))]), (mean + floor)[None]
    levels = np.linspace(load.min(), load.max(), count)
    share = np.maximum(0.0, 1.0 - np.abs(load[:, None] - levels) / (levels[1] - levels[0]))
    each = np.einsum("kl,kp,kq->lpq", share, left, left, optimize=True) / share.sum(axis=0)[:, None, None]
    size = np.trace(each, axis1=1, axis2=2) / np.trace(mean)
    return levels, (1.0 - SHRUNK) * each + SHRUNK * size[:, None, None] * mean + floor
