"""Fits polynomials from the change of fields or poses to forces, so that they hold on another day.

One session does not show the differences of the next: gains and rotations of the sensors relative to the magnet, and
the field at rest. So the polynomials are fitted to copies of the presses as of other days, drawn from a stated prior:
they do not lean on differences that another day would change (regression with errors in the variables). Powers and
deviations come from presses that a fit was not told: whole sessions, or eighths of the time of a single one; both drawn
as other days.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_skin.force_model import DIRECTIONS, MOST_POWER, ForceMap, Mask, Route, monomials

Indices = NDArray[np.intp]
# Another day, as standard deviations: gain and rotation of each sensor; a value at rest, as a share of the rest field.
GAIN, ROTATION_RAD, OFFSET = 0.03, 0.03, 0.01
COPIES, TESTED_COPIES = 6, 3
EIGHTHS = 8
# Share of the monomials' squares that is added: it keeps the normal equations regular.
RIDGE = 1e-6
ROWS_OF_A_NUMBER, FEWEST_ROWS = 4, 150
WORTH = 0.02  # a larger power must lower the error by this share
OUTERMOST = 0.99  # the share of presses whose leverage is below 1
ROUNDS = 40  # rounds in which floor and share of the variance are found
LEAST_N = 1e-3


@dataclass(frozen=True, slots=True)
class Presses:
    """values (K, V): changes over the scale of the rest, NaN where not known. sensor, axis (V,): of each value; those
    of one sensor turn together. force_n (K, 3). session (K,): numbers."""

    route: Route
    names: tuple[str, ...]
    values: Array
    sensor: Indices
    axis: Indices
    force_n: Array
    session: Indices

    def rows(self, members: Mask) -> Presses:
        return replace(self, values=self.values[members], force_n=self.force_n[members], session=self.session[members])

    @property
    def known(self) -> Mask:
        known: Mask = np.isfinite(self.values)
        return known

    def having(self, values: Mask) -> Presses:
        """The rows in which all of these values (V,) are known."""
        return self.rows(np.asarray((self.known | ~values).all(axis=1), dtype=np.bool_))

    def folds(self) -> Indices:
        """(K,): what is left out together: sessions, or eighths of the time of a single one."""
        if len(np.unique(self.session)) > 1:
            return self.session
        return np.arange(len(self.values)) * EIGHTHS // len(self.values)

    def other_days(self, count: int, random: np.random.Generator) -> tuple[Array, Array]:
        """Values (count · K, V) and forces of the same presses on `count` other days; unknown values are 0."""
        values = np.where(self.known, self.values, 0.0)
        days = [values @ self._day(random).T + OFFSET * random.standard_normal(len(self.names)) for _ in range(count)]
        return np.concatenate(days), np.tile(self.force_n, (count, 1))

    def _day(self, random: np.random.Generator) -> Array:
        """(V, V): what gains and small rotations of the sensors make of the values."""
        whole = np.zeros((len(self.names), len(self.names)))
        for sensor in np.unique(self.sensor):
            own = np.flatnonzero(self.sensor == sensor)
            x, y, z = ROTATION_RAD * random.standard_normal(3)
            turned = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) + np.eye(3)
            gain = 1.0 + GAIN * random.standard_normal()
            whole[np.ix_(own, own)] = gain * turned[np.ix_(self.axis[own], self.axis[own])]
        return whole


def fit_maps(presses: Presses, origin: str, say: Say) -> tuple[ForceMap, ...]:
    """Polynomials of all values, and of those sets of them that the presses, or a sensor that fails, leave."""
    if len(presses.values) < FEWEST_ROWS:
        raise DataError(f"{origin}: {len(presses.values)} rows with a force; {FEWEST_ROWS} are needed")
    with threadpool_limits(1):  # sums have a fixed order, so that the same rows give the same file
        power = _best_power(presses, say)
        maps = [_map_of(presses, known, power) for known in _sets(presses)]
    found = tuple(one for one in maps if one is not None)
    if not found:
        raise DataError(f"{origin}: too few rows have the same values: fields are clipped or missing in most rows")
    return found


def _sets(presses: Presses) -> list[Mask]:
    """All values, those that rows have, and those that are left without one of the sensors; the largest first."""
    whole = np.ones(len(presses.names), dtype=np.bool_)
    without = [presses.sensor != one for one in np.unique(presses.sensor)]
    sets = {one.tobytes(): one for one in (whole, *np.unique(presses.known, axis=0), *without) if one.any()}
    return sorted(sets.values(), key=lambda one: -int(one.sum()))


def _best_power(presses: Presses, say: Say) -> int:
    """The smallest power of which the error on left-out rows is within WORTH of the best."""
    whole = np.ones(len(presses.names), dtype=np.bool_)
    size = np.sqrt(np.mean(presses.force_n**2, axis=0)).clip(min=LEAST_N)
    errors: dict[int, float] = {}
    for power in range(1, MOST_POWER + 1):
        left = _left_out(presses, whole, power)
        if left is not None:
            errors[power] = float(np.sqrt(np.mean((left.error / size) ** 2)))
    if not errors:
        return 1
    best = min(errors.values())
    chosen = min(power for power, error in errors.items() if error <= (1.0 + WORTH) * best)
    told = ", ".join(f"{power}: {error:.1%}" for power, error in errors.items())
    say(f"route {presses.route}: error on left-out rows by power, as a share of the forces: {told}; {chosen} it is")
    return chosen


def _map_of(presses: Presses, known: Mask, power: int) -> ForceMap | None:
    """None where too few rows have these values."""
    while power and (left := _left_out(presses, known, power)) is None:
        power -= 1
    if not power or left is None:
        return None
    fitted = _fitted(presses.having(known), known, power)
    assert fitted is not None
    floor_n2, share = _variance(left)
    return replace(fitted, floor_n2=floor_n2, share=share)


@dataclass(frozen=True, slots=True)
class _LeftOut:
    """error, found (R, 3) of rows that were left out of the fit. leverage (R,)."""

    error: Array
    found: Array
    leverage: Array


def _left_out(presses: Presses, known: Mask, power: int) -> _LeftOut | None:
    usable = presses.having(known)
    folds, parts = usable.folds(), []
    for fold in np.unique(folds):
        fitted = _fitted(usable.rows(folds != fold), known, power)
        if fitted is None:
            return None
        out = usable.rows(folds == fold)
        values, force_n = out.other_days(TESTED_COPIES, np.random.default_rng([1, int(fold)]))
        found = fitted.find(values)
        parts.append(_LeftOut(found.force - force_n, found.force, found.leverage))
    if len(parts) < 2:
        return None
    return _LeftOut(*(np.concatenate([getattr(one, name) for one in parts]) for name in _LeftOut.__slots__))


def _fitted(presses: Presses, known: Mask, power: int) -> ForceMap | None:
    """The polynomial of rows that have these values. None: too few rows for its numbers."""
    values, force_n = presses.other_days(COPIES, np.random.default_rng(0))
    if len(presses.values) < max(FEWEST_ROWS // 2, ROWS_OF_A_NUMBER * _count(int(known.sum()), power)):
        return None
    basis = monomials(values, known, power)
    scale = np.sqrt(np.mean(basis**2, axis=0))
    shrunk = basis / scale
    normal = shrunk.T @ shrunk / len(shrunk) + RIDGE * np.eye(len(scale))
    weight = np.linalg.solve(normal, shrunk.T @ force_n / len(shrunk))
    spread = np.linalg.inv(normal)
    own = monomials(np.where(presses.known, presses.values, 0.0), known, power) / scale
    spread /= np.quantile(((own @ spread) * own).sum(axis=1), OUTERMOST)
    nothing = np.zeros(DIRECTIONS)
    return ForceMap(known, power, scale, weight, (spread + spread.T) / 2.0, nothing, nothing)


def _count(values: int, power: int) -> int:
    """The number of monomials."""
    return sum(int(np.prod([(values + k) / (k + 1) for k in range(degree)]).round()) for degree in range(1, power + 1))


def _variance(left: _LeftOut) -> tuple[Array, Array]:
    """floor_n2, share (3,): the most likely variance floor + share · force² of the errors."""
    square = left.error**2 / np.maximum(left.leverage, 1.0)[:, None]
    force2 = (left.found**2).sum(axis=1)[:, None]
    floor = np.maximum(square.mean(axis=0) / 2.0, LEAST_N**2)
    share = floor / force2.mean()
    for _ in range(ROUNDS):
        weight = 1.0 / (floor + share * force2)
        floor = floor * (square * weight**2).sum(axis=0) / weight.sum(axis=0)
        weight = 1.0 / (floor + share * force2)
        share = share * (force2 * square * weight**2).sum(axis=0) / (force2 * weight).sum(axis=0)
    return np.maximum(floor, LEAST_N**2), share
