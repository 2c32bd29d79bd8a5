"""Estimates the sensitivities of the chips by turning the unloaded pad: all see one vector, the Earth's field.

At orientation k every sensor reports y_k = K·Rᵀ·u_k + o. u_k has the constant length E; o is the field of the pad's
magnet, which turns along, and the chip's offset. The common gain and rotation of all sensors stay unknown: the field at
rest determines them as far as the magnet's place is known. See V. Renaudin, M. H. Afzal and G. Lachapelle, "Complete
triaxis magnetometer calibration in the magnetic domain", J. Sensors (2010); here the chips share each u_k, instead of
an ellipsoid for each chip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, log, square
from fmfts.arithmetic.matrix import (
    inverse,
    least_squares,
    lengths,
    product,
    root_of_squares,
    singular_values,
    solve,
)
from fmfts.baseline import sensitivity
from fmfts.baseline.bundle import Reduced
from fmfts.baseline.evenness import INDEPENDENT, STRENGTH_DEVIATION, unevenness
from fmfts.baseline.recording import BaselineError, solvable
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.turn_misfit import TurnMisfit
from fmfts.baseline.window_means import MEAN_OF, Means
from fmfts.pad import Pad

Array = NDArray[np.float64]

# With 100 means of MEAN_OF frames the noise leaves 0.03 % of a gain; more would cost file size and time and gain
# nothing. Fast turns need shorter windows, and more of them: up to the second number.
ORIENTATIONS, MOST_ORIENTATIONS = 100, 400
# The difference of the field between sensors 16 mm apart.
UNEVEN_DEVIATION_T = 5e-8
# The field's sweep along the direction in which it moved least: at least this, and this share of the largest sweep.
SMALLEST_SWEEP_T, SMALLEST_SHARE = 2e-5, 0.5
ITERATIONS, SETTLED = 20, 1e-8
NO_ONE_FIELD = (
    "no one field explains what the sensors saw while the robot turned: compare geometry.sensors_mm and "
    "geometry.sensor_rotations with the board (`probe --magnet` does so), leave the pad untouched, and turn more slowly"
)


@dataclass(frozen=True, slots=True)
class Turn:
    """Fields (K, N, 3) in sensor axes at K orientations, the deviation (N, 3) of each, and their times (K,)."""

    field_t: Array
    deviation_t: Array
    time_s: Array

    @classmethod
    def of(cls, means: Means) -> Turn:
        count = min(ORIENTATIONS * MEAN_OF // means.mean_of, MOST_ORIENTATIONS)
        chosen = np.unique(np.linspace(0, len(means.field_t) - 1, count).round().astype(np.intp))
        return cls(means.field_t[chosen], means.noise_t / np.sqrt(means.mean_of), means.time_s[chosen])


def sensitivity_from_turn(pad: Pad, before: Sensitivity, turn: Turn) -> Sensitivity:
    """Estimate the sensitivities from what was known `before` and a turn.

    BaselineError if the orientations do not span space, or another field changed.
    """
    _require_span(pad, turn)
    with solvable(NO_ONE_FIELD):
        fit = _fitted(pad, before, turn, STRENGTH_DEVIATION)
        inflation = _misfit(pad, turn, fit).inflation
        uneven = unevenness(turn.field_t - fit.offset, fit.by_field(pad), _deviation(turn) * inflation)
        if uneven > STRENGTH_DEVIATION:
            fit = _fitted(pad, before, turn, uneven)
        misfit = _misfit(pad, turn, fit)
        misfit.require_untouched()
        # If the misfits are larger than expected, the recording gets less weight; the prior keeps its own.
        normal = _linearised(pad, turn, fit, misfit.inflation).normal + np.diag(_prior(before, len(pad.sensors)))
        scale = 1.0 / np.sqrt(np.diagonal(normal))
        covariance = inverse(normal * scale * scale[:, None]) * scale * scale[:, None]
    known = len(before.mean)
    return Sensitivity(fit.values, covariance[:known, :known])


@dataclass(frozen=True, slots=True)
class _Fit:
    """Sensitivities (9N,), the field (K, 3) at each orientation, offsets (N, 3), and the field's usual strength.

    uneven: the relative standard deviation of the field's strength.
    """

    values: Array
    field: Array
    offset: Array
    strength: float
    uneven: float

    def by_field(self, pad: Pad) -> Array:
        """(N, 3, 3) what the chips report of unit fields in pad axes."""
        by_field: Array = product(sensitivity.matrices(self.values), pad.sensors.axes.transpose(0, 2, 1))
        return by_field

    def expected(self, pad: Pad) -> Array:
        """(K, N, 3) what they report at each orientation."""
        return _reported(pad, self.values, self.field) + self.offset

    def stepped(self, reduced: Reduced, step: Array) -> _Fit:
        known = len(self.values)
        return replace(
            self,
            values=self.values + step[:known],
            offset=self.offset + step[known:-1].reshape(self.offset.shape),
            strength=self.strength * exp(step[-1]),
            field=self.field + reduced.own_steps(step),
        )


def _fitted(pad: Pad, before: Sensitivity, turn: Turn, uneven: float) -> _Fit:
    fit = _Fit(before.mean, *_first_guess(pad, turn), uneven)
    known, prior = len(before.mean), _prior(before, len(pad.sensors))
    for _ in range(ITERATIONS):
        reduced = _linearised(pad, turn, fit, 1.0)
        normal, gradient = reduced.normal + np.diag(prior), reduced.gradient.copy()
        gradient[:known] -= prior[:known] * (fit.values - before.mean)
        # Offsets are about 1e-4, the other unknowns about one; scaling makes the equations well conditioned.
        scale = 1.0 / np.sqrt(np.diagonal(normal))
        step = scale * solve(normal * scale * scale[:, None], scale * gradient)
        fit = fit.stepped(reduced, step)
        if np.abs(step[:known]).max() < SETTLED:
            break
    return fit


def _misfit(pad: Pad, turn: Turn, fit: _Fit) -> TurnMisfit:
    return TurnMisfit(turn.field_t - fit.expected(pad), _deviation(turn), fit.by_field(pad), turn.time_s)


def _prior(before: Sensitivity, count: int) -> Array:
    """(12N + 1,) the prior information on each shared unknown, as 1/variance: none on offsets and strength.

    A tolerance of zero means that the value is exact; the floor avoids a division by zero.
    """
    of_values = 1.0 / np.maximum(np.diagonal(before.covariance), 1e-18)
    return np.concatenate([of_values, np.zeros(3 * count + 1)])


def _reported(pad: Pad, values: Array, field: Array) -> Array:
    """(K, N, 3) what chips of these sensitivities report of the ambient fields (K, 3), without offsets."""
    seen = pad.sensors.to_sensor(np.repeat(field[:, None], len(pad.sensors), axis=1))
    reported: Array = product(sensitivity.matrices(values), seen[..., None])[..., 0]
    return reported


def _linearised(pad: Pad, turn: Turn, fit: _Fit, inflation: float) -> Reduced:
    """Shared unknowns: sensitivities (9N), offsets (3N), log strength. Own: field (3). Rows: 3N values, strength."""
    orientations, count = len(turn.field_t), len(pad.sensors)
    deviation = inflation * _deviation(turn, _repeated(orientations))
    seen = pad.sensors.to_sensor(np.repeat(fit.field[:, None], count, axis=1))
    rows, known = 3 * count, len(fit.values)
    residual = np.empty((orientations, rows + 1))
    own = np.empty((orientations, rows + 1, 3))
    columns = np.zeros((orientations, rows + 1, known + rows + 1))
    sizes = lengths(fit.field)
    residual[:, :-1] = ((turn.field_t - fit.expected(pad)) / deviation).reshape(orientations, rows)
    strength_deviation = fit.uneven * _repeated(orientations)
    residual[:, -1] = (log(fit.strength) - np.array([log(size) for size in sizes])) / strength_deviation
    own[:, :-1] = (fit.by_field(pad) / deviation[:, :, None]).reshape(rows, 3)
    own[:, -1] = fit.field / (square(sizes) * strength_deviation)[:, None]
    diagonal = np.arange(rows)
    by_value = np.array([sensitivity.columns(one) for one in seen])
    columns[:, :-1, :known] = (by_value / deviation[:, :, None]).reshape(orientations, rows, known)
    columns[:, diagonal, known + diagonal] = 1.0 / deviation.ravel()
    columns[:, -1, -1] = -1.0 / strength_deviation
    return Reduced.of(own, columns, residual)


def _deviation(turn: Turn, repeated: float = 1.0) -> Array:
    """The deviation (N, 3) of a mean from the field that all chips share."""
    deviation: Array = root_of_squares(turn.deviation_t, UNEVEN_DEVIATION_T * repeated)
    return deviation


def _repeated(orientations: int) -> float:
    """Factor on the deviation of each orientation, so that many count no more than INDEPENDENT ones."""
    return float(np.sqrt(max(orientations / INDEPENDENT, 1.0)))


def _first_guess(pad: Pad, turn: Turn) -> tuple[Array, Array, float]:
    """Field (K, 3), offsets (N, 3) and strength for ideal chips: fits a sphere, which is a linear problem."""
    mean = turn.field_t.mean(axis=0)
    swept = pad.sensors.to_pad(turn.field_t - mean).mean(axis=1)
    equations = np.column_stack([2.0 * swept, np.full(len(swept), 1e-5)])
    centre = least_squares(equations, square(swept).sum(axis=1))[:3]
    field = swept - centre
    offset = mean + pad.sensors.to_sensor(np.tile(centre, (len(mean), 1)))
    return field, offset, float(np.sqrt(square(field).sum(axis=1).mean()))


def _require_span(pad: Pad, turn: Turn) -> None:
    swept = pad.sensors.to_pad(turn.field_t - turn.field_t.mean(axis=0)).mean(axis=1)
    sweep = np.ptp(product(swept, singular_values(swept)[2]), axis=0)
    needed = max(SMALLEST_SWEEP_T, SMALLEST_SHARE * sweep.max())
    if sweep.max() < SMALLEST_SWEEP_T:
        raise BaselineError(
            f"the robot did not turn: the field moved by {sweep.max() * 1e4:.2f} G only, and it moves by more than "
            f"{SMALLEST_SWEEP_T * 1e4:.2f} G where a robot turns in the Earth's field: begin again, and turn the robot "
            "while the recording runs: half around about one axis, then about another one, across the first"
        )
    if sweep.min() < needed:
        arc = 2.0 * np.degrees(np.arcsin(min(1.0, sweep.min() / sweep.max())))
        wanted = 2.0 * np.degrees(np.arcsin(SMALLEST_SHARE))
        figures = ", ".join(f"{value * 1e4:.2f}" for value in sorted(sweep, reverse=True))
        raise BaselineError(
            f"the robot was not turned about enough axes: the field swept {figures} G along its three main directions, "
            f"and the least must be {needed * 1e4:.2f} G: turn it half around about one axis, then by at least "
            f"{wanted:.0f}° (now {arc:.0f}°) about another one, across the first"
        )
