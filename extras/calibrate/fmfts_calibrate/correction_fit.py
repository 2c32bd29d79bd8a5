"""Chooses the smallest correction of a known response that explains presses left out of its fit.

A pad with several magnets and a pad with one are corrected in the same way. They compare a press by different values:
the field (array_fit.py) or the magnet's pose (pad_fit.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.array_response import LARGEST_ERROR, SHIPPED_ERROR
from fmfts.pad import Array
from fmfts_calibrate.array_correction import Correction
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.press_set import PressSet, Rows

FOLDS = 5
ITERATIONS, SETTLED, LONGEST_STEP = 8, 0.02, 1.0  # lengths of steps in deviations of the parameters
WEIGHED = 2  # iterations after which C is constant
# A larger correction must lower the mean square of left-out presses by this share, or by the differences between the
# folds.
WORTHWHILE = 0.02
# A press has a wrong label if it is this many deviations off and the others agree this much better without it.
WRONG_LABEL, AGREE_BETTER = 8.0, 0.6


@dataclass(frozen=True)
class Predictions(ABC):
    """Predicts presses of one set.

    levels: of the correction, from the smallest; labels_by: the one that is used to find wrong labels. may_stay:
    whether "no correction" may be chosen.
    """

    levels: ClassVar[tuple[str, ...]]
    labels_by: ClassVar[str]
    may_stay: ClassVar[bool]

    data: PressSet
    correction: Correction

    @abstractmethod
    def predicted(
        self, theta: Array, rows: Rows, error: float | None, free: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array, Array, Array | None]:
        """Residual (R, V) of rows, its slopes by the free parameters (R, V, U) and by place and force (R, V, 3); with
        an error of the response, the lower triangles (R, V, V) of C, the covariance through noise, labels, the baseline
        and the response itself."""

    def only(self, rows: Rows) -> Self:
        """The fit of some of the presses."""
        return replace(self, data=self.data.only(rows))

    def fitted(self, rows: Rows, level: str) -> Array:
        """The most likely parameters, given these rows."""
        theta, deviation = self.correction.none, self.correction.deviation
        if level == "none":
            return theta
        free = self.correction.free(level, self.data.has_shear)
        triangle = np.empty(0)
        for step_number in range(ITERATIONS):
            # The errors of labels and baseline scale with the movement, so C is recomputed until the movement is about
            # right.
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


@dataclass(frozen=True, slots=True)
class Level:
    """A level of the correction, and its prediction of presses left out of its fit. left_out: mean square of a value,
    in deviations. spread: difference between the folds.

     error (K, 3): of place and force.
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
class Corrected:
    """levels: all that were tried, no correction first. chosen: of them, with its parameters theta, and the fits of
    which presses were left out."""

    levels: tuple[Level, ...]
    chosen: str
    theta: Array
    left: LeftOutFits


@dataclass(frozen=True, slots=True)
class LeftOutFits:
    """For left-out presses: theta of the fit without them, for each fold, and its rows."""

    folds: tuple[tuple[Array, Rows], ...]
    of_press: Array  # (K,) mean square of a value, in deviations


def smallest_correction(predictions: Predictions, whose: str, say: Say) -> Corrected:
    """whose: names the set in errors. DataError where a label is wrong."""
    levels, left = [], []
    for name in ("none", *predictions.levels):
        level, residuals = _left_out(predictions, name)
        levels.append(level)
        left.append(residuals)
        say(
            "{correction:>6}: {parameters:3d} numbers; presses left out of the fit: {left_out_in_deviations:7.2f} "
            "deviations, {place_rms_mm:.3f} mm, {force_rms_n:.4f} N".format(**level.facts())
        )
    chosen = _chosen(levels, 0 if predictions.may_stay else 1)
    _require_good_labels(whose, predictions, left[chosen], say)
    name = levels[chosen].name
    theta = predictions.fitted(np.arange(len(predictions.data.press)), name)
    say(f"chosen: {name}")
    return Corrected(tuple(levels), name, theta, left[chosen])


def _left_out(predictions: Predictions, level: str) -> tuple[Level, LeftOutFits]:
    press, correction = predictions.data.press, predictions.correction
    error, of_press = np.empty((len(press), 3)), np.empty(len(press))
    means, folds = [], []
    for out in _folds(press):
        inside = np.flatnonzero(~np.isin(np.arange(len(press)), out))
        theta = predictions.fitted(inside, level)
        residual, _, by_label, root = predictions.predicted(theta, out, SHIPPED_ERROR)
        assert root is not None
        white = np.linalg.solve(root, residual[:, :, None])[:, :, 0]
        of_press[out] = np.mean(np.square(white), axis=1)
        means.append(of_press[out].mean())
        for row, one, slope, triangle in zip(out, white, by_label, root, strict=True):
            error[row] = np.linalg.lstsq(np.linalg.solve(triangle, slope), one, rcond=None)[0]
        folds.append((theta, out))
    numbers = 0 if level == "none" else int(correction.free(level, predictions.data.has_shear).sum())
    spread = float(np.std(means) / np.sqrt(FOLDS))
    return Level(level, numbers, float(of_press.mean()), spread, error), LeftOutFits(tuple(folds), of_press)


def _folds(press: Array) -> Iterator[Rows]:
    """Rows to leave out: all presses of a place at once, because the others there would give the answer. With fewer
    places than folds, presses are left out one by one."""
    places, which = np.unique(press[:, :2], axis=0, return_inverse=True)
    if len(places) < FOLDS:
        places, which = press, np.arange(len(press))
    fold = np.random.default_rng(4).permutation(np.arange(len(places)) % FOLDS)[which.ravel()]
    for number in range(FOLDS):
        yield np.flatnonzero(fold == number)


def _chosen(levels: list[Level], first: int) -> int:
    """The smallest from `first` on that is as good as the best, apart from small or random differences."""
    best = min(levels, key=lambda level: level.left_out)
    allowed = best.left_out * (1.0 + WORTHWHILE) + best.spread
    return next(
        number for number in range(first, len(levels)) if levels[number].left_out <= allowed or best is levels[0]
    )


def error_of_table(predictions: Predictions, left: LeftOutFits, whose: str) -> float:
    """The response's own relative error, with which left-out presses have the stated deviations. DataError if it is too
    large."""

    def mean_square(error: float) -> float:
        total, count = 0.0, 0
        for theta, rows in left.folds:
            residual, _, _, root = predictions.predicted(theta, rows, error)
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


def _require_good_labels(whose: str, predictions: Predictions, left: LeftOutFits, say: Say) -> None:
    """DataError where one press is far off, and the others agree much better without it."""
    off = np.sqrt(left.of_press)
    worst = int(np.argmax(off))
    x, y, force = predictions.data.press[worst, :3].tolist()
    which = f"row {predictions.data.line[worst]} ({x:g}, {y:g}) mm, {force:g} N"
    say(f"the press that fits worst: {which}: {off[worst]:.1f} deviations")
    if off[worst] < WRONG_LABEL:
        return
    others = predictions.only(np.delete(np.arange(len(off)), worst))
    without, _ = _left_out(others, predictions.labels_by)
    if np.sqrt(without.left_out) < AGREE_BETTER * np.sqrt(np.mean(left.of_press)):
        raise DataError(
            f"{whose}: {which}: its field is {off[worst]:.0f} deviations from what the other presses say, and without "
            f"it those agree to {np.sqrt(without.left_out):.1f}: is its label wrong? Correct that row, or leave it out"
        )
