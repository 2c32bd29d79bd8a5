"""Estimates the sensitivities of the chips by turning the unloaded pad: all see one vector, the Earth's field.

At orientation k every sensor reports y_k = K·Rᵀ·u_k + o. u_k has the constant length E; o is the field of the pad's
magnet, which turns along, and the chip's offset. The gain and the rotation that all sensors have in common stay
unknown: the field at rest tells them as far as the magnet's place is known. See V. Renaudin, M. H. Afzal and
G. Lachapelle, "Complete triaxis magnetometer calibration in the magnetic domain", J. Sensors (2010); here the chips
share each u_k, instead of an ellipsoid for each chip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, log, square
from fmfts.arithmetic.matrix import (
    complement,
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
from fmfts.baseline.recording import BaselineError
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.window_means import MEAN_OF, Means
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad

Array = NDArray[np.float64]

# With 100 the noise leaves 0.03 % of a gain; more would cost file size and time and gain nothing.
ORIENTATIONS = 100
# In a workshop the strength of the field differs by this over the path of a turned pad. It changes smoothly: of many
# orientations only so many count as independent.
STRENGTH_DEVIATION, INDEPENDENT = 0.005, 10
# The difference of the field between sensors 16 mm apart.
UNEVEN_DEVIATION_T = 5e-8
# The field's sweep along the direction in which it moved least: at least this, and this share of the largest sweep.
SMALLEST_SWEEP_T, SMALLEST_SHARE = 2e-5, 0.5
# Steel that turns with the pad makes the field's strength depend on the attitude. The workshop's own share, which no
# gain explains, is below STRENGTH_DEVIATION; screws that reach three times that made a sound sensor look wrong.
LARGEST_UNEVENNESS = 3.0
STEEL_TURNS = (
    "Steel turns with the pad, as screws in its mount do, or stands near: move it 30 mm away from the sensors, and "
    "turn again; bare and rest alone do not mind it"
)
# Probability that an orientation of an untouched pad counts as touched; larger misfits than this, in expected
# deviations, are not caused by a touch.
FALSE_TOUCH = 1e-6
LARGEST_MISFIT = 5.0
ITERATIONS, SETTLED = 20, 1e-8


@dataclass(frozen=True, slots=True)
class Turn:
    """Fields (K, N, 3) in sensor axes at K orientations, the deviation (N, 3) of each, and their times (K,)."""

    field_t: Array
    deviation_t: Array
    time_s: Array

    @classmethod
    def of(cls, means: Means) -> Turn:
        chosen = np.unique(np.linspace(0, len(means.field_t) - 1, ORIENTATIONS).round().astype(np.intp))
        return cls(means.field_t[chosen], means.noise_t / np.sqrt(MEAN_OF), means.time_s[chosen])


def sensitivity_from_turn(pad: Pad, before: Sensitivity, turn: Turn) -> Sensitivity:
    """Estimate the sensitivities from what was known `before` and a turn.

    BaselineError if the orientations do not span space, or another field changed.
    """
    _require_span(pad, turn)
    deviation = root_of_squares(turn.deviation_t, UNEVEN_DEVIATION_T * _repeated(len(turn.field_t)))
    count = len(pad.sensors)
    field, offset, strength = _first_guess(pad, turn)
    values, known = before.mean, len(before.mean)
    # A tolerance of zero means that the value is exact; the floor avoids a division by zero.
    prior = 1.0 / np.maximum(np.diagonal(before.covariance), 1e-18)
    for _ in range(ITERATIONS):
        reduced = _linearised(pad, turn.field_t, deviation, (values, offset, strength), field)
        normal, gradient = reduced.normal.copy(), reduced.gradient.copy()
        normal[range(known), range(known)] += prior
        gradient[:known] -= prior * (values - before.mean)
        # Offsets are about 1e-4, the other unknowns about one; scaling makes the equations well conditioned.
        scale = 1.0 / np.sqrt(np.diagonal(normal))
        step = scale * solve(normal * scale * scale[:, None], scale * gradient)
        field = field + reduced.own_steps(step)
        values = values + step[:known]
        offset = offset + step[known:-1].reshape(count, 3)
        strength *= exp(step[-1])
        if np.abs(step[:known]).max() < SETTLED:
            break
    by_field = product(sensitivity.matrices(values), pad.sensors.axes.transpose(0, 2, 1))
    _require_even(field, strength)
    inflation = _judged(turn, _reported(pad, values, field) + offset, by_field)
    # If the misfits are larger than expected, the recording gets less weight; the prior keeps its own.
    reduced = _linearised(pad, turn.field_t, deviation * inflation, (values, offset, strength), field)
    normal = reduced.normal + np.diag(np.concatenate([prior, np.zeros(3 * count + 1)]))
    scale = 1.0 / np.sqrt(np.diagonal(normal))
    covariance = inverse(normal * scale * scale[:, None]) * scale * scale[:, None]
    return Sensitivity(values, covariance[:known, :known])


def _reported(pad: Pad, values: Array, field: Array) -> Array:
    """(K, N, 3) what chips of these sensitivities report of the ambient fields (K, 3), without offsets."""
    seen = pad.sensors.to_sensor(np.repeat(field[:, None], len(pad.sensors), axis=1))
    reported: Array = product(sensitivity.matrices(values), seen[..., None])[..., 0]
    return reported


def _linearised(
    pad: Pad, measured: Array, deviation: Array, shared: tuple[Array, Array, float], field: Array
) -> Reduced:
    """Shared unknowns: sensitivities (9N), offsets (3N), log strength. Own: field (3). Rows: 3N values, strength."""
    values, offset, strength = shared
    orientations, count = len(measured), len(pad.sensors)
    seen = pad.sensors.to_sensor(np.repeat(field[:, None], count, axis=1))
    rows, known = 3 * count, len(values)
    residual = np.empty((orientations, rows + 1))
    own = np.empty((orientations, rows + 1, 3))
    columns = np.zeros((orientations, rows + 1, known + rows + 1))
    sizes = lengths(field)
    misfit = measured - _reported(pad, values, field) - offset
    residual[:, :-1] = (misfit / deviation).reshape(orientations, rows)
    strength_deviation = STRENGTH_DEVIATION * _repeated(orientations)
    residual[:, -1] = (log(strength) - np.array([log(size) for size in sizes])) / strength_deviation
    by_field = product(sensitivity.matrices(values), pad.sensors.axes.transpose(0, 2, 1))
    own[:, :-1] = (by_field / deviation[:, :, None]).reshape(rows, 3)
    own[:, -1] = field / (square(sizes) * strength_deviation)[:, None]
    diagonal = np.arange(rows)
    by_value = np.array([sensitivity.columns(one) for one in seen])
    columns[:, :-1, :known] = (by_value / deviation[:, :, None]).reshape(orientations, rows, known)
    columns[:, diagonal, known + diagonal] = 1.0 / deviation.ravel()
    columns[:, -1, -1] = -1.0 / strength_deviation
    return Reduced.of(own, columns, residual)


def _repeated(orientations: int) -> float:
    """Factor on a deviation of each orientation, so that many tell no more than INDEPENDENT ones."""
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


def _require_even(field: Array, strength: float) -> None:
    """BaselineError if the strength of the ambient field (K, 3) depends on the attitude as by no workshop."""
    uneven = np.array([log(size) for size in lengths(field)]) - log(strength)
    share = float(np.sqrt(square(uneven).mean()))
    if share > LARGEST_UNEVENNESS * STRENGTH_DEVIATION:
        raise BaselineError(
            f"the ambient field became stronger and weaker by {share * 1e2:.1f} % (mean) while the robot turned, "
            f"where {STRENGTH_DEVIATION * 1e2:.1f} % is usual. {STEEL_TURNS}"
        )


def _judged(turn: Turn, expected_t: Array, by_field: Array) -> float:
    """How much larger than expected the misfits are, at least 1. BaselineError if a touch, steel or a chip caused them.

    by_field (N, 3, 3): what the chips report of unit ambient fields.
    """
    deviation = root_of_squares(turn.deviation_t, UNEVEN_DEVIATION_T)
    misfit = turn.field_t - expected_t
    chi2 = square(misfit / deviation).sum(axis=(1, 2))
    inflation, touched = _compared(chi2, misfit[0].size - 3)
    worst = int(np.argmax(chi2))
    when = f"{turn.time_s[worst]:.1f} s after the start"
    if inflation <= LARGEST_MISFIT and not touched.any():
        return inflation
    alone = _sensor_alone(misfit / deviation[None], by_field / deviation[..., None])
    if alone is not None:
        raise BaselineError(
            f"sensor {alone + 1} alone does not see the field turn that the others see: it is off by "
            f"{np.abs(misfit[worst, alone]).max() * 1e7:.0f} mG {when} ({touched.sum()} of {len(chi2)} orientations): "
            "its chip's offset jumped, as after a strong field, bits of its readings flip, or steel passed close to "
            "it: turn again, and if it stays, run selftest and look at its wires"
        )
    if inflation > LARGEST_MISFIT:
        raise BaselineError(
            f"the sensors do not see one field turn: they disagree by {np.sqrt(np.mean(square(misfit))) * 1e7:.1f} mG, "
            f"where {np.sqrt(np.mean(square(deviation))) * 1e7:.1f} mG is noise, most {when}: leave the pad untouched, "
            "keep steel away, and turn again"
        )
    raise BaselineError(
        f"the pad was touched, or passed steel, {when}: the sensors disagree by "
        f"{np.abs(misfit[worst]).max() * 1e7:.0f} mG there ({touched.sum()} of {len(chi2)} orientations): leave it "
        "untouched: turn again, and hold the robot, not the pad"
    )


def _compared(chi2: Array, freedom: int) -> tuple[float, NDArray[np.bool_]]:
    """How much larger than expected the misfits (K,) are, at least 1, and which (K,) of them stand out even so."""
    inflation = max(1.0, float(np.sqrt(np.median(chi2) / freedom)))
    return inflation, np.asarray(chi2 > quantile(FALSE_TOUCH / len(chi2), freedom) * square(inflation), dtype=np.bool_)


def _sensor_alone(misfit: Array, by_field: Array) -> int | None:
    """The only sensor (from 0) without which the others see one field turn; None if there is none, or more than one.

    A touch moves the magnet, which is as far from every sensor as from every other: all of them see it. What happens to
    one chip, or on its way, is in that chip's readings alone. misfit (K, N, 3), by_field (N, 3, 3): in deviations.
    """
    count = misfit.shape[1]
    found = []
    for sensor in range(count) if count > 2 else ():
        others = np.arange(count) != sensor
        # What no ambient field can be: so it does not depend on the field that was estimated with the bad sensor.
        parity = complement(by_field[others].reshape(-1, 3)).T
        chi2 = square(product(misfit[:, others].reshape(len(misfit), -1), parity.T)).sum(axis=1)
        inflation, touched = _compared(chi2, len(parity))
        if inflation <= LARGEST_MISFIT and not touched.any():
            found.append(sensor)
    return found[0] if len(found) == 1 else None
