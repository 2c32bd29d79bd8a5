"""Fits a correction of a table of presses to measured fields: the smallest that explains presses left out of the fit.

The field is what is measured, and the table is judged by the field that it predicts: C is what noise, labels, the
baseline and the table itself may be off in it. Poses are not solved first: eight sensors know four poses with one value
to spare, and some directions badly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.calibrate.array_correction import LEVELS, Correction
from fmfts.calibrate.array_set import ArraySet
from fmfts.calibrate.field_table import DataError
from fmfts.calibrate.labelled_poses import Say
from fmfts.contact.array_response import LARGEST_ERROR, SHIPPED_ERROR, ArrayResponse
from fmfts.pad import Array
from fmfts.pose.magnets import field_and_slope, field_of
from fmfts.several.field_model import MM

Rows = NDArray[np.intp]

FEWEST_PRESSES, FEWEST_PLACES = 18, 9
FOLDS = 5
ITERATIONS, SETTLED, LONGEST_STEP = 8, 0.02, 1.0  # in deviations of the parameters
WEIGHED = 2  # iterations after which C stays
# A larger correction must lower what is left of the left-out fields' squares by so much, or by what the folds differ.
WORTHWHILE = 0.02
# A press whose field is so many deviations off has a wrong label, if the others agree so much better without it.
WRONG_LABEL, AGREE_BETTER = 8.0, 0.6


@dataclass(frozen=True, slots=True)
class Level:
    """A step of the correction, and how well it predicts presses that are left out of its fit.

    left_out: mean square of a value, in deviations. spread: what the folds differ by. error (K, 3): of place and force.
    """

    name: str
    parameters: int
    left_out: float
    spread: float
    error: Array

    def facts(self) -> dict[str, Any]:
        return {
            "correction": self.name,
            "parameters": self.parameters,
            "left_out_in_deviations": round(float(np.sqrt(self.left_out)), 3),
            "place_rms_mm": round(float(np.sqrt(np.square(self.error[:, :2]).sum(axis=1).mean())), 4),
            "force_rms_n": round(float(np.sqrt(np.square(self.error[:, 2]).mean())), 4),
        }


@dataclass(frozen=True, slots=True)
class FittedTable:
    """response: the table. levels: all that were tried, the uncorrected table first. chosen: of them. force_factor:
    on the forces that the start needs for the same movement."""

    response: ArrayResponse
    levels: tuple[Level, ...]
    chosen: str
    force_factor: float


@dataclass(frozen=True)
class _Fields:
    """Predicts the fields of presses of one set. noise_t2 (3N,)."""

    data: ArraySet
    correction: Correction
    noise_t2: Array

    @cached_property
    def of_map(self) -> Array:
        return self.correction.map_at(self.data.press[:, :2], self.off_mm)

    @cached_property
    def off_mm(self) -> Array:
        drawn = np.array([one.rest_position_m for one in self.data.pad.magnets])
        off: Array = (self.data.mounting.magnets.position_m - drawn)[:, :2] * 1e3
        return off

    def predicted(
        self, theta: Array, rows: Rows, error: float | None, free: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array, Array, Array | None]:
        """Residual (R, V) of rows, its slopes by the free parameters (R, V, U) and by place and force (R, V, 3); with
        an error of the table, the lower triangles (R, V, V) of C."""
        data, mounting = self.data, self.data.mounting
        unit = np.tile(MM, len(mounting.magnets))
        change, by_theta, by_press = self.correction.presses(theta, data.press[rows], self.off_mm, self.of_map[rows])
        by_theta = by_theta[:, :, np.zeros(len(theta), dtype=np.bool_) if free is None else free]
        values = len(self.noise_t2)
        at_rest = field_of(mounting.magnets, mounting.sensors).ravel()
        by_ambient = mounting.sensors.axes.transpose(0, 2, 1).reshape(values, 3)
        residual, slope = np.empty((len(rows), values)), np.empty((len(rows), values, by_theta.shape[2]))
        by_label = np.empty((len(rows), values, 3))
        root = None if error is None else np.empty((len(rows), values, values))
        for number, row in enumerate(rows.tolist()):
            moved = mounting.magnets.changed(change[number] * unit, mounting.frames)
            field, by_pose = field_and_slope(moved, mounting.frames, mounting.sensors)
            by_pose = by_pose * unit
            residual[number] = data.change_t[row] - (field.ravel() - at_rest)
            slope[number] = by_pose @ by_theta[number]
            by_label[number] = by_pose @ by_press[number]
            if root is None or error is None:
                continue
            factors = [
                data.ambient_t[row] * by_ambient,
                mounting.errors.at(change[number] * unit, np.zeros(3)),
                by_label[number] * data.press_deviation[row],
                by_pose * (error * change[number]),
            ]
            factor = np.concatenate(factors, axis=1)
            root[number] = np.linalg.cholesky(factor @ factor.T + np.diag(self.noise_t2))
        return residual, slope, by_label, root

    def fitted(self, rows: Rows, level: str) -> Array:
        """The most likely parameters, given these rows."""
        theta, deviation = self.correction.none, self.correction.deviation
        free = self.correction.free(level, self.data.has_shear)
        triangle = np.empty(0)
        for step_number in range(ITERATIONS):
            # What the labels and the baseline may be off goes with the movement: once it is about right it stays.
            error = SHIPPED_ERROR if step_number < WEIGHED else None
            residual, slope, _, root = self.predicted(theta, rows, error, free)
            triangle = triangle if root is None else root
            white = np.linalg.solve(triangle, residual[:, :, None])[:, :, 0].ravel()
            by = np.linalg.solve(triangle, slope).reshape(len(white), -1) * deviation[free]
            prior = theta[free] / deviation[free]
            step = np.linalg.solve(by.T @ by + np.eye(by.shape[1]), by.T @ white - prior)
            step *= min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), SETTLED))
            theta = theta.copy()
            theta[free] += step * deviation[free]
            if np.abs(step).max() < SETTLED and step_number >= WEIGHED:
                break
        return theta


def fit_table(data: ArraySet, whose: str, start: ArrayResponse, noise_t: float, say: Say) -> FittedTable:
    """The table of this pad. whose: names the set in errors. noise_t: of a value of the set.

    DataError where the presses are too few, or no correction explains their fields.
    """
    with threadpool_limits(1):  # gives the same file with any number of cores, and leaves the others free
        return _fitted(data, whose, start, noise_t, say)


def _fitted(data: ArraySet, whose: str, start: ArrayResponse, noise_t: float, say: Say) -> FittedTable:
    data = _on_the_table(data, whose, start, say)
    _require_enough(whose, data.press)
    centre_mm = np.array([one.rest_position_m[:2] for one in data.pad.magnets]) * 1e3
    noise_t2 = np.square(noise_t / data.mounting.gain).ravel()
    fields = _Fields(data, Correction.of(start, centre_mm), noise_t2)
    levels, left = [], []
    for name in ("none", *LEVELS):
        level, residuals = _left_out(fields, name)
        levels.append(level)
        left.append(residuals)
        say(
            "{correction:>6}: {parameters:3d} numbers; presses left out of the fit: {left_out_in_deviations:7.2f} "
            "deviations, {place_rms_mm:.3f} mm, {force_rms_n:.4f} N".format(**level.facts())
        )
    chosen = _chosen(levels)
    _require_good_labels(whose, fields, left[chosen], say)
    error = _error(fields, left[chosen], whose)
    rows, name = np.arange(len(data.press)), levels[chosen].name
    theta = fields.correction.none if name == "none" else fields.fitted(rows, name)
    say(f"chosen: {name}; the table's own error is {error:.1%} of a movement")
    table = fields.correction.table(theta, error)
    return FittedTable(table, tuple(levels), name, float(np.exp(-theta[0])))


@dataclass(frozen=True, slots=True)
class _Residuals:
    """Of presses left out: theta of the fit that did not know them, for each fold, and its rows."""

    folds: tuple[tuple[Array, Rows], ...]
    of_press: Array  # (K,) mean square of a value, in deviations


def _left_out(fields: _Fields, level: str) -> tuple[Level, _Residuals]:
    data, correction = fields.data, fields.correction
    error, of_press = np.empty((len(data.press), 3)), np.empty(len(data.press))
    means, folds = [], []
    for out in _folds(data.press):
        inside = np.flatnonzero(~np.isin(np.arange(len(data.press)), out))
        theta = correction.none if level == "none" else fields.fitted(inside, level)
        residual, _, by_label, root = fields.predicted(theta, out, SHIPPED_ERROR)
        assert root is not None
        white = np.linalg.solve(root, residual[:, :, None])[:, :, 0]
        of_press[out] = np.mean(np.square(white), axis=1)
        means.append(of_press[out].mean())
        for row, one, slope, triangle in zip(out, white, by_label, root, strict=True):
            error[row] = np.linalg.lstsq(np.linalg.solve(triangle, slope), one, rcond=None)[0]
        folds.append((theta, out))
    numbers = 0 if level == "none" else int(correction.free(level, data.has_shear).sum())
    spread = float(np.std(means) / np.sqrt(FOLDS))
    return Level(level, numbers, float(of_press.mean()), spread, error), _Residuals(tuple(folds), of_press)


def _folds(press: Array) -> Iterator[Rows]:
    """Rows to leave out; all presses of a place at once, for the others would tell what is there."""
    places, which = np.unique(press[:, :2], axis=0, return_inverse=True)
    fold = np.random.default_rng(4).permutation(np.arange(len(places)) % FOLDS)[which.ravel()]
    for number in range(FOLDS):
        yield np.flatnonzero(fold == number)


def _chosen(levels: list[Level]) -> int:
    """The smallest that is as good as the best, but for what is not worthwhile or by chance."""
    best = min(levels, key=lambda level: level.left_out)
    allowed = best.left_out * (1.0 + WORTHWHILE) + best.spread
    return next(number for number, level in enumerate(levels) if level.left_out <= allowed)


def _error(fields: _Fields, left: _Residuals, whose: str) -> float:
    """The table's own error, relative, by which presses that it does not know are as wrong as is said."""

    def mean_square(error: float) -> float:
        total, count = 0.0, 0
        for theta, rows in left.folds:
            residual, _, _, root = fields.predicted(theta, rows, error)
            assert root is not None
            white = np.linalg.solve(root, residual[:, :, None])
            total, count = total + float(np.square(white).sum()), count + white.size
        return total / count

    low, high = SHIPPED_ERROR, LARGEST_ERROR
    if mean_square(low) <= 1.0:
        return low
    if mean_square(high) > 1.0:
        raise DataError(
            f"{whose}: no correction of the table explains these fields: presses left out of its fit are missed by "
            f"more than {LARGEST_ERROR:.0%} of what the magnets move: is it this pad, and its baseline, and are x and "
            "y those of the pad?"
        )
    while high / low > 1.02:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if mean_square(middle) > 1.0 else (low, middle)
    return round(high, 5)


def _require_good_labels(whose: str, fields: _Fields, left: _Residuals, say: Say) -> None:
    """DataError where one press is far off, and the others agree much better without it."""
    data, off = fields.data, np.sqrt(left.of_press)
    worst = int(np.argmax(off))
    x, y, force = data.press[worst, :3].tolist()
    told = f"row {data.line[worst]} ({x:g}, {y:g}) mm, {force:g} N"
    say(f"the press that fits worst: {told}: {off[worst]:.1f} deviations")
    if off[worst] < WRONG_LABEL:
        return
    others = replace(fields, data=_only(data, np.delete(np.arange(len(off)), worst)))
    without, _ = _left_out(others, "places")
    if np.sqrt(without.left_out) < AGREE_BETTER * np.sqrt(np.mean(left.of_press)):
        raise DataError(
            f"{whose}: {told}: its field is {off[worst]:.0f} deviations from what the other presses say, and without "
            f"it those agree to {np.sqrt(without.left_out):.1f}: is its label wrong? Correct that row, or leave it out"
        )


def _on_the_table(data: ArraySet, whose: str, start: ArrayResponse, say: Say) -> ArraySet:
    """Without presses beyond the table's places."""
    inside = ((data.press[:, :2] >= start.first_mm) & (data.press[:, :2] <= start.last_mm)).all(axis=1)
    if not inside.all():
        say(
            f"{whose}: {int((~inside).sum())} presses are beyond ±{start.last_mm:g} mm, where a table of presses ends: "
            "left out"
        )
    return _only(data, np.flatnonzero(inside))


def _only(data: ArraySet, rows: Rows) -> ArraySet:
    return replace(
        data,
        press=data.press[rows],
        press_deviation=data.press_deviation[rows],
        change_t=data.change_t[rows],
        ambient_t=data.ambient_t[rows],
        line=tuple(data.line[row] for row in rows.tolist()),
    )


def _require_enough(whose: str, press: Array) -> None:
    places, forces = len(np.unique(press[:, :2], axis=0)), len(np.unique(np.round(press[:, 2], 1)))
    if len(press) < FEWEST_PRESSES or places < FEWEST_PLACES:
        raise DataError(
            f"{whose}: {len(press)} presses at {places} places; a table of a pad with several magnets needs "
            f"{FEWEST_PRESSES} presses at {FEWEST_PLACES} places all over it"
        )
    if forces < 2:
        raise DataError(f"{whose}: column force_n: all presses have one force: press each place with two at least")
