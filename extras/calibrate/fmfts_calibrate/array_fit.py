"""Fits a correction of a table of presses to measured fields: the smallest that explains presses left out of the fit.

The field is what is measured, and the table is judged by the field that it predicts: C is the covariance through noise,
labels, the baseline and the table itself. Poses are not solved first: eight sensors determine four poses with one
redundant value, and some directions poorly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.contact.array_response import ArrayResponse
from fmfts.pad import Array
from fmfts.pose.magnets import field_and_slope, field_of
from fmfts.several.field_model import MM
from fmfts_calibrate.array_correction import LEVELS, Correction
from fmfts_calibrate.array_set import ArraySet
from fmfts_calibrate.correction_fit import Level, Predictions, error_of_table, smallest_correction
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.press_set import Rows

FEWEST_PRESSES, FEWEST_PLACES = 18, 9


@dataclass(frozen=True, slots=True)
class FittedTable:
    """response: the table. levels: all that were tried, the uncorrected table first. chosen: of them. force_factor: on
    the start's forces for the same movement."""

    response: ArrayResponse
    levels: tuple[Level, ...]
    chosen: str
    force_factor: float


@dataclass(frozen=True)
class _Fields(Predictions):
    """Predicts the fields of presses of one set. noise_t2 (3N,)."""

    levels = LEVELS
    labels_by = "places"
    may_stay = True

    data: ArraySet
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


def fit_table(data: ArraySet, whose: str, start: ArrayResponse, noise_t: float, say: Say) -> FittedTable:
    """The table of this pad. whose: names the set in errors. noise_t: of a value of the set.

    DataError where the presses are too few, or no correction explains their fields.
    """
    with threadpool_limits(1):  # one thread: the same file with any number of cores
        return _fitted(data, whose, start, noise_t, say)


def _fitted(data: ArraySet, whose: str, start: ArrayResponse, noise_t: float, say: Say) -> FittedTable:
    data = _on_the_table(data, whose, start, say)
    _require_enough(whose, data.press)
    centre_mm = np.array([one.rest_position_m[:2] for one in data.pad.magnets]) * 1e3
    noise_t2 = np.square(noise_t / data.mounting.gain).ravel()
    fields = _Fields(data, Correction.of(start, centre_mm), noise_t2)
    made = smallest_correction(fields, whose, say)
    error = error_of_table(fields, made.left, whose)
    say(f"the table's own error is {error:.1%} of a movement")
    table = fields.correction.table(made.theta, error)
    return FittedTable(table, made.levels, made.chosen, float(np.exp(-made.theta[0])))


def _on_the_table(data: ArraySet, whose: str, start: ArrayResponse, say: Say) -> ArraySet:
    """The set without presses beyond the table's places."""
    inside = ((data.press[:, :2] >= start.first_mm) & (data.press[:, :2] <= start.last_mm)).all(axis=1)
    if not inside.all():
        say(
            f"{whose}: {int((~inside).sum())} presses are beyond ±{start.last_mm:g} mm, where a table of presses ends: "
            "left out"
        )
    return data.only(np.flatnonzero(inside))


def _require_enough(whose: str, press: Array) -> None:
    places, forces = len(np.unique(press[:, :2], axis=0)), len(np.unique(np.round(press[:, 2], 1)))
    if len(press) < FEWEST_PRESSES or places < FEWEST_PLACES:
        raise DataError(
            f"{whose}: {len(press)} presses at {places} places; a table of a pad with several magnets needs "
            f"{FEWEST_PRESSES} presses at {FEWEST_PLACES} places all over it"
        )
    if forces < 2:
        raise DataError(f"{whose}: column force_n: all presses have one force: press each place with two at least")
