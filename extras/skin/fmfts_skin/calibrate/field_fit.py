"""Makes a table from contact to field of labelled fields: penalised splines, and how far frames are from them.

The change of the field from the rest is fitted; no load means no change. If rows of an untouched pad give the rest, the
newest counts. If there are none, it is fitted to the presses (field_rest.py), together with the drift: the moment of
all magnets, which warm by some kelvin within hours (a per cent), and the rest of each sensor, as slow curves over rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_skin.calibrate.field_rest import Rest, rest_of_presses
from fmfts_skin.calibrate.field_set import FieldSet, Indices
from fmfts_skin.calibrate.field_splines import SplineFit
from fmfts_skin.field_response import Axis, FieldResponse

PLACE_SPACING_MM, MOST_CELLS = 2.0, 16
LOAD_CELLS_BESIDE_PLACES, LOAD_CELLS_ALONE = 4, 12
ROUGHNESS = (1e-4, 1e-3, 1e-2, 1e-1)
DRIFT_ROUGHNESS = 1e-2  # share of the table that the drift is compared with
FOLDS = 4
FEWEST_ROWS = 150
# Rows for each knot of the drift, and rounds in which table and drift are fitted in turn.
DRIFT_ROWS, MOST_DRIFT_KNOTS, ROUNDS = 400, 8, 5
REST_DRIFT_UT, ROW_UT = 15.0, 10.0  # deviations: of a drifting rest, and of one row from the table
# Levels of load with a covariance of their own: each needs this many rows for each value of a frame.
ROWS_OF_A_VALUE, MOST_LEVELS = 12, 9
SHRUNK = 0.05  # pulls towards the mean of all levels, because a level has few rows
STEP_UT = 2.0  # the chip's step: no value is known more precisely
# An untouched pad's rest does not predict from which field the next recording starts under load, within this: pressing
# a printed pad releases a set of tens of µT.
REPEATED_UT = 8.0
# Deviation of the moment from frame to frame, beside a stretch's mean, where no rest row measures it: 0.5 to 2 K.
MOMENT_SHARE = 0.003
# The loads with which two pads of one structure, or two days of one pad, change the field equally differ by this share.
# eFlesh's printed pad softened by 3 % between two recordings six minutes apart; a stage's height of contact is off by
# 10 %.
LOAD_SHARE = {"depth_mm": 0.1, "force_n": 0.03, "shear_n": 0.03}


class Drift(NamedTuple):
    """The drift of each row: moment (K,), about zero, and rest_ut (K, P), about zero."""

    moment: Array
    rest_ut: Array


def make_response(data: FieldSet, origin: str, say: Say) -> FieldResponse:
    """The table of the labelled rows. origin: written into the file. DataError where there are too few rows."""
    known = data.labelled
    if known.sum() < FEWEST_ROWS:
        raise DataError(f"{origin}: {known.sum()} rows with a contact that is known; a table needs {FEWEST_ROWS}")
    rests = data.rest_ut()[known]
    has_rest = bool(np.isfinite(rests).all())
    if not has_rest and len(data.axes) == 1:
        raise DataError(f"{origin}: no rows of rest (rest = 1) in some recording: a single place cannot replace them")
    contact, recording = data.contact[known], data.recording[known]
    with threadpool_limits(1):  # sums have a fixed order, so that the same rows give the same table
        if has_rest:
            rest = Rest(rests.mean(axis=0), 0.0)
            target = data.field_ut[known] - rests
        else:
            rest, target = _without_drift(data.axes, contact, data.field_ut[known], recording, say)
        axes = _axes(data.axes, contact, rest.load)
        squares = [np.mean(_left_out(SplineFit(axes, one, rest.load), contact, target) ** 2) for one in ROUGHNESS]
        fit = SplineFit(axes, ROUGHNESS[int(np.argmin(squares))], rest.load)
        coefficient = fit.of(contact, target)
        left = _left_out(fit, contact, target)
    levels, covariance = _covariance(contact[:, -1], left, REPEATED_UT if has_rest else STEP_UT)
    say(
        f"{len(contact)} rows, {len(coefficient)} numbers for each value; left-out rows are "
        f"{np.sqrt(np.mean(left**2)):.1f} µT off"
    )
    return FieldResponse(
        axes,
        rest.field_ut,
        has_rest,
        coefficient.reshape(*(axis.cells + 3 for axis in axes), target.shape[1]),
        tuple(levels.tolist()),
        covariance,
        0.0 if has_rest else MOMENT_SHARE,
        LOAD_SHARE[data.axes[-1]],
        origin,
    )


def _without_drift(
    names: tuple[str, ...], contact: Array, field_ut: Array, recording: Indices, say: Say
) -> tuple[Rest, Array]:
    """The rest, and the changes from it (K, P) as without drift: table and drift are fitted in turn."""
    axes = _axes(names, contact, float(contact[:, -1].min()))
    fit = SplineFit(axes, DRIFT_ROUGHNESS, None)
    drift, clean = Drift(np.zeros(len(contact)), np.zeros_like(field_ut)), field_ut
    for _ in range(ROUNDS):
        drift = _drift(field_ut, fit.basis(contact) @ fit.of(contact, clean), recording)
        clean = (field_ut - drift.rest_ut) / (1.0 + drift.moment)[:, None]
    rest = rest_of_presses(axes[:-1], contact, clean, names[-1])
    say(
        f"no rows of rest: the moment drifted by {np.ptp(drift.moment):.2%} within the set, and contacts begin at "
        f"{names[-1]} {rest.load:.3g}, as fitted"
    )
    return rest, clean - rest.field_ut


def _axes(names: tuple[str, ...], contact: Array, unloaded: float) -> tuple[Axis, ...]:
    """Knots over the range of the rows; those of the load from where nothing presses."""
    axes = []
    for number, name in enumerate(names):
        values = contact[:, number]
        load = number == len(names) - 1
        first, last = float(values.min()), float(values.max())
        if not last > first:
            raise DataError(f"column {name} has one value, {first:g}: leave the column out, or press elsewhere, too")
        if load:
            wanted = LOAD_CELLS_ALONE if len(names) == 1 else LOAD_CELLS_BESIDE_PLACES
            first = min(first, unloaded)
        else:
            wanted = min(round((last - first) / PLACE_SPACING_MM), MOST_CELLS)
        cells = max(1, min(wanted, len(np.unique(np.round(values, 2))) // 2))
        axes.append(Axis(name, first, (last - first) / cells, cells))
    return tuple(axes)


def _left_out(fit: SplineFit, contact: Array, target: Array) -> Array:
    """(K, P): residuals of rows, each from a fit that was not told it."""
    fold = np.random.default_rng(0).permutation(len(contact)) % FOLDS
    residual = np.empty_like(target)
    for number in range(FOLDS):
        out = fold == number
        residual[out] = target[out] - fit.basis(contact[out]) @ fit.of(contact[~out], target[~out])
    return residual


def _drift(target: Array, table: Array, recording: Indices) -> Drift:
    """Moment and rest over the rows of each recording, from the table's residuals."""
    moment, rest = np.zeros(len(target)), np.zeros_like(target)
    for number in np.unique(recording):
        rows = np.flatnonzero(recording == number)
        knots = int(np.clip(len(rows) // DRIFT_ROWS, 1, MOST_DRIFT_KNOTS))
        time = Axis("row", 0.0, max(len(rows) - 1, 1) / knots, knots)
        curve = SplineFit((time,), 0.0, None).basis(np.arange(len(rows), dtype=float)[:, None])
        size = np.einsum("kp,kp->k", table[rows], table[rows])
        share = np.einsum("kp,kp->k", table[rows], target[rows] - table[rows])
        ridge = 1e-9 * size.sum() * np.eye(curve.shape[1])
        moment[rows] = curve @ np.linalg.solve(curve.T @ (size[:, None] * curve) + ridge, curve.T @ share)
        left = target[rows] - (1.0 + moment[rows])[:, None] * table[rows]
        ridge = curve.shape[1] * (ROW_UT / REST_DRIFT_UT) ** 2 * np.eye(curve.shape[1])
        rest[rows] = curve @ np.linalg.solve(curve.T @ curve + ridge, curve.T @ left)
    return Drift(moment - moment.mean(), rest - rest.mean(axis=0))


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
