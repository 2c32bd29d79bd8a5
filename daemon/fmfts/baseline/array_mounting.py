"""The mounted pad with several magnets: rest poses and moments of all, places and gains of the sensors.

As `mounting.py` for one magnet: the maximum a posteriori over all errors of mounting and manufacture, with the
tolerances as priors, from the field at rest. Four magnets over eight sensors have 123 unknowns and 24 values, so most
of them stay as uncertain as their tolerances. What stays uncertain is kept as the errors that it causes in a change of
the field (`FieldErrors`), which every estimate of fingers takes into account.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import cholesky, eigen, inverse, lengths, product, solve, solve_lower_transposed
from fmfts.baseline import sensitivity
from fmfts.baseline.array_unknowns import OF_MAGNET, ArrayUnknowns
from fmfts.baseline.most_probable import most_probable
from fmfts.baseline.mounting import ambient_of
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.baseline.sensitivity import Sensitivity, split
from fmfts.baseline.unknowns import AMBIENT_DEVIATION_T
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad, SensorArray, Tolerance
from fmfts.pose import FieldErrors
from fmfts.pose.magnets import CHANGE, Magnets, field_and_slope, rest_frames, sum_of_fields

Array = NDArray[np.float64]

FALSE_REFUSAL = 1e-5  # the probability of refusing a pad that is within its tolerances
# The typical change of a magnet's pose by a press, for which the errors of a change are computed.
TYPICAL_CHANGE = np.array([2e-5, 2e-5, 4e-4, 3e-2, 3e-2])
# A press moves each magnet down; the errors are those of a change half way.
HALF_A_PRESS = np.array([0.0, 0.0, -2e-4, 0.0, 0.0])
# Number of independent causes of errors that are kept for each sensor; a pad with fewer than eight sensors keeps as
# many as one with eight. The neglected ones are 2 to 3 % of the variance with eight and with sixteen sensors.
# FMFTS_SEVERAL_CAUSES has room.
CAUSES_A_SENSOR, FEWEST_CAUSES = 6, 48


@dataclass(frozen=True, slots=True)
class ArrayMounting:
    """A pad of M magnets and N sensors as it is mounted.

    magnets: at rest. frames (M, 3, 3): see `rest_frames`. gain (N, 3), sensors: of the chips as built. offset_t (N, 3):
    the field at rest, along the sensors' axes, without the magnets': the ambient field, and the unexplained rest.
    rest_field_t (N, 3): of the magnets at rest. noise_t (N, 3): of one sample. errors: of a change of the field, from
    the recording's uncertainty. log_moment (M,). rest_covariance (6M, 6M): of position, tilt and log moment of each.
    chi2: misfit, priors included, of `measurements` values. misfit_t (N, 3). ambient_t, ambient_deviation_t (3,): from
    the bare recording, None without one.
    """

    magnets: Magnets
    frames: Array
    gain: Array
    sensors: SensorArray
    offset_t: Array
    rest_field_t: Array
    noise_t: Array
    errors: FieldErrors
    log_moment: Array
    rest_covariance: Array
    chi2: float
    measurements: int
    misfit_t: Array
    ambient_t: Array | None
    ambient_deviation_t: Array | None

    def magnet_field(self, measured_t: Array) -> Array:
        """The magnets' field along the sensors' axes from the measured one, both (N, 3)."""
        return measured_t / self.gain - self.offset_t

    def moved_since(self, pad: Pad, recording: Recording) -> Array:
        """Displacement (3,) in m since then of the magnet that moved most."""
        return moved_since(self, recording)[0]

    def remanence_t(self, pad: Pad) -> float:
        """The mean strength of the magnets, as the remanence of magnets of the sizes in the drawing."""
        return float(np.mean([one * exp(log) for one, log in zip(_remanences(pad), self.log_moment, strict=True)]))

    def remanences_t(self, pad: Pad) -> list[float]:
        """As remanence_t, of each magnet."""
        return [one * exp(log) for one, log in zip(_remanences(pad), self.log_moment.tolist(), strict=True)]


def estimate_array_mounting(
    pad: Pad, tolerance: Tolerance, rest: Recording, bare: Recording | None, measured: Sensitivity
) -> ArrayMounting:
    """The most probable mounting, from the field at rest and, if it was recorded, the field without the pad.

    BaselineError if no pad within the tolerances explains the field.
    """
    unknowns = ArrayUnknowns.of(pad, tolerance, bare is None, measured)
    data, variance = rest.mean_t, square(rest.mean_deviation_t)
    if bare is not None:
        data, variance = data - bare.mean_t, variance + square(bare.mean_deviation_t)
    weight = 1.0 / np.sqrt(variance.ravel())
    scaled, normal = most_probable(unknowns, data, weight, np.zeros(len(unknowns.deviation)))
    magnets, ambient_t, places, matrix = unknowns.unpack(scaled)
    predicted, _ = unknowns.predict(magnets, ambient_t, places, matrix)
    misfit = data - predicted
    chi2 = float(np.sum(square(weight * misfit.ravel())) + product(scaled, unknowns.precision, scaled))
    limit = quantile(FALSE_REFUSAL, data.size)
    if chi2 > limit:
        worst = np.unravel_index(int(np.argmax(np.abs(misfit))), misfit.shape)
        raise BaselineError(
            f"the field does not fit an unloaded pad: χ² = {chi2:.0f}, where tolerances, gains and noise explain at "
            f"most {limit:.0f}; worst: sensor {worst[0] + 1}, axis {'xyz'[worst[1]]}. Is something on the pad, a "
            "magnet missing or upside down, or are [[pad.magnet]] and sensors_mm those of another pad?"
        )
    covariance = inverse(normal)
    gain, axes = split(matrix, pad.sensors.axes)
    sensors = SensorArray(places, axes)
    rest_field = sensors.to_sensor(sum_of_fields(magnets, places))
    ambient, ambient_deviation = (None, None) if bare is None else ambient_of(pad, bare)
    first, scale = unknowns.of_magnets, unknowns.deviation
    in_si = covariance * scale * scale[:, None]
    return ArrayMounting(
        magnets=magnets,
        frames=rest_frames(magnets.axis),
        gain=gain,
        sensors=sensors,
        offset_t=rest.mean_t / gain - rest_field,
        rest_field_t=rest_field,
        noise_t=rest.noise_t,
        errors=_errors(unknowns, scaled, normal),
        log_moment=(scale * scaled)[:first].reshape(-1, OF_MAGNET)[:, 5],
        rest_covariance=in_si[:first, :first],
        chi2=chi2,
        measurements=data.size,
        misfit_t=misfit,
        ambient_t=ambient,
        ambient_deviation_t=ambient_deviation,
    )


def moved_since(before: ArrayMounting, recording: Recording) -> tuple[Array, Array]:
    """Displacement (3,) in m since `before` of the magnet that moved most, and the change of the ambient field (3,)
    in T, to first order."""
    change = (before.magnet_field(recording.mean_t) - before.rest_field_t).ravel()
    slope = field_and_slope(before.magnets, before.frames, before.sensors)[1]
    by_ambient = before.sensors.axes.transpose(0, 2, 1).reshape(change.size, 3)
    scale = np.concatenate([np.tile([1e-3, 1e-3, 1e-3, 0.1, 0.1], len(before.magnets)), np.full(3, 1e-4)])
    weighted = np.concatenate([slope, by_ambient], axis=1) * scale / recording.mean_deviation_t.ravel()[:, None]
    normal = product(weighted.T, weighted) + np.eye(len(scale))
    solved = scale * solve(normal, product(weighted.T, change / recording.mean_deviation_t.ravel()))
    moved = solved[: CHANGE * len(before.magnets)].reshape(-1, CHANGE)[:, :3]
    farthest: Array = moved[int(np.argmax(lengths(moved)))]
    return farthest, solved[CHANGE * len(before.magnets) :]


def _errors(unknowns: ArrayUnknowns, scaled: Array, normal: Array) -> FieldErrors:
    """The errors of a change of the field; at rest the baseline absorbs them, so only those of the change count."""
    magnets, _, places, matrix = unknowns.unpack(scaled)
    gain = split(matrix, unknowns.pad.sensors.axes)[0].ravel()
    frames, none = rest_frames(magnets.axis), np.zeros(3)
    size = CHANGE * len(magnets)
    half = np.tile(HALF_A_PRESS, len(magnets))
    turned = np.empty((size, gain.size, len(scaled)))
    for direction in range(size):
        step = np.zeros(size)
        step[direction] = TYPICAL_CHANGE[direction % CHANGE] / 2.0
        less, more = (
            unknowns.predict(magnets.changed(half + sign * step, frames), none, places, matrix)[1]
            for sign in (-1.0, 1.0)
        )
        turned[direction] = (more - less) * unknowns.deviation / gain[:, None]
    count = len(places)
    by_axes = sensitivity.matrices(np.eye(9 * count)).reshape(count, 3, 3, -1)
    by_field = product(unknowns.pad.sensors.axes[:, None], by_axes).reshape(3 * count, 3, -1) / gain[:, None, None]
    # The causes' effect on the field, in units in which each has one deviation.
    all_by_field = np.zeros((gain.size, 3, len(scaled)))
    all_by_field[:, :, -9 * count :] = by_field * unknowns.deviation[-9 * count :]
    # The covariance of these errors, with the typical changes as weights, has a few large directions: they are kept.
    root = solve_lower_transposed(cholesky(normal), np.eye(len(scaled)))  # root · rootᵀ = normal⁻¹
    by_pose = product(turned.reshape(-1, len(scaled)), root)
    all_by_field = product(all_by_field.reshape(-1, len(scaled)), root)
    rows = np.concatenate([by_pose, all_by_field * (AMBIENT_DEVIATION_T / 10.0)])
    power, causes = eigen(product(rows.T, rows))
    kept = causes[:, np.argsort(power, kind="stable")[::-1][: max(FEWEST_CAUSES, CAUSES_A_SENSOR * count)]]
    typical = np.tile(TYPICAL_CHANGE, len(magnets))[:, None, None]
    return FieldErrors(
        product(by_pose, kept).reshape(size, gain.size, -1) / typical,
        product(all_by_field, kept).reshape(gain.size, 3, -1),
    )


def _remanences(pad: Pad) -> list[float]:
    return [one.magnet.remanence_t for one in pad.magnets]
