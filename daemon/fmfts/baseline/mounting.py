"""The mounted pad: rest pose, magnet, sensor places and gains, estimated from the field at rest.

No pad is exactly like its drawing. So the rest pose is estimated: the maximum a posteriori over all errors of mounting
and manufacture, with the tolerances as priors. Contact uses the change from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, log, square
from fmfts.arithmetic.matrix import inverse, lengths, log_determinant, product, root_of_squares
from fmfts.baseline.leftover import TELLS_LITTLE, TILT, Leftover
from fmfts.baseline.most_probable import ITERATIONS, most_probable
from fmfts.baseline.presses import PressBundle, Presses
from fmfts.baseline.recording import Recording
from fmfts.baseline.sensitivity import Sensitivity, relative_deviation, split
from fmfts.baseline.unknowns import Unknowns
from fmfts.pad import Pad, SensorArray, Tolerance
from fmfts.pose import FREE_FIELD, FieldErrors, State, dipole_field
from fmfts.pose import solve as solve_pose

Array = NDArray[np.float64]

ITERATIONS_TO_COMPARE = 8  # a search that has not converged by then has a wrong assumption
BROKEN_T = 5e-5  # deviation of a broken sensor's reading: the Earth's field


@dataclass(frozen=True, slots=True)
class Mounting:
    """A pad as it is mounted: all that is needed to get the magnet's field, with its deviation, from a measured one.

    rest: the unloaded magnet. rest_covariance: (6, 6) of its step (position, axis, log moment).
    gain, axes: (N, 3) and (N, 3, 3) of the chips as built: see `sensitivity.split`. sensor_position_m: (N, 3).
    offset_t: (N, 3) in sensor axes, the field at rest without the magnet's: the ambient field, and what no parameter
    explains, so that an untouched pad has no residual. rest_field_t: (N, 3) the magnet's field at rest.
    noise_t: (N, 3) of one sample. sensitivity_deviation: (N, 3, 3) error of each axis per change of the field along
    each axis of its chip. place_deviation: (N, 1) relative error of a change of the magnet's field alone.
    systematic_t: a further constant error of every value.
    leftover: what the rest field left uncertain, None if rest was not recorded.
    chi2: misfit, priors included, of `measurements` values. misfit_t: (N, 3) measured − predicted. surprise: −2 ln of
    the evidence for what was assumed, without a constant that all assumptions about one recording share.
    rest_strain: (5,) distance of the estimated rest pose from the drawing's, in deviations of such estimates for pads
    that are within their tolerances: the recording tells only a part of the distance.
    ambient_t, ambient_deviation_t: (3,) from the bare recording, None without one.
    pad_turn: (3, 3) from the sensors' axes to those of the pad as it most likely stands: presses move its magnet in
    these.
    press_chi2: (K,) misfit of each press, if there were any, with 3N − 5 degrees of freedom.
    """

    rest: State
    rest_covariance: Array
    gain: Array
    axes: Array
    sensor_position_m: Array
    offset_t: Array
    rest_field_t: Array
    noise_t: Array
    sensitivity_deviation: Array
    place_deviation: Array
    systematic_t: float
    leftover: Leftover | None
    chi2: float
    measurements: int
    misfit_t: Array
    rest_strain: Array
    ambient_t: Array | None
    ambient_deviation_t: Array | None
    surprise: float = 0.0
    press_chi2: Array = field(default_factory=lambda: np.zeros(0))
    pad_turn: Array = field(default_factory=lambda: np.eye(3))

    def drifted(self, moved: Array) -> Mounting:
        """A copy with the magnet's rest pose moved by (5,), in m, and in rad in the tangent plane of its axis."""
        return replace(self, rest=self.rest.stepped(moved))

    def mounted(self, pad: Pad) -> Pad:
        """The drawing with the estimated sensor places and axes, and rest pose."""
        return replace(
            pad,
            sensors=SensorArray(self.sensor_position_m, self.axes),
            rest_position_m=self.rest.position_m,
            rest_axis=self.rest.axis,
        )

    def remanence_t(self, pad: Pad) -> float:
        """The strength of this pad's magnet, as the remanence of a magnet of the size in the drawing."""
        return pad.magnet.remanence_t * exp(self.rest.log_moment)

    def magnet_field(self, measured_t: Array) -> Array:
        """The magnet's field along `axes` from the measured field, both (N, 3): removes gains and ambient field."""
        return measured_t / self.gain - self.offset_t

    def moved_since(self, pad: Pad, recording: Recording) -> Array:
        """Displacement (3,) of the magnet since then, in m; the ambient field may have turned."""
        field_t, deviation_t = self.magnet_field(recording.mean_t), recording.mean_deviation_t
        estimate = solve_pose(field_t, self.mounted(pad), self.rest, deviation_t=deviation_t, free=FREE_FIELD)
        return estimate.position_m - self.rest.position_m

    def field_errors(self) -> FieldErrors | None:
        """The errors of the field that the baseline leaves; None before rest was recorded."""
        return None if self.leftover is None else self.leftover.field_errors()

    def change_error(self, solved: NDArray[np.intp]) -> Array:
        """(8, 5, M) error of a unit change of pose and ambient field; see `Leftover.change_error`."""
        return np.zeros((8, 5, 0)) if self.leftover is None else self.leftover.change_error(solved)

    def ambient_error(self, solved: NDArray[np.intp]) -> Array:
        """(8, 3, M) error of the ambient field's change; see `Leftover.ambient_error`."""
        return np.zeros((8, 3, 0)) if self.leftover is None else self.leftover.ambient_error(solved)


def estimate_mounting(
    pad: Pad,
    tolerance: Tolerance,
    rest: Recording,
    bare: Recording | None,
    used: NDArray[np.bool_] | None = None,
    measured: Sensitivity | None = None,
    presses: Presses | None = None,
    to_compare: bool = False,
) -> Mounting:
    """The most probable mounting, from the field at rest and, if it was recorded, the field without the pad.

    With a bare recording, the difference of the two is the magnet's field, and the ambient field is measured. Without
    one the ambient field is a further unknown, and its estimate is too inaccurate to publish (18–31 mG off). used: (N,)
    sensors to use, None: all. measured: sensitivities, None: only their tolerances are known. presses: fields of
    presses that move the magnet, None: no presses. They need all sensors. to_compare: fast, for one of many
    assumptions: without second-order errors, and a search that does not converge ends early.
    """
    count = len(pad.sensors)
    unknowns = Unknowns.of(pad, tolerance, bare is None, measured)
    data, variance = rest.mean_t, square(rest.mean_deviation_t) + square(unknowns.model_deviation_t)
    if bare is not None:
        data, variance = data - bare.mean_t, variance + square(bare.mean_deviation_t)
    believed = np.repeat(np.ones(count, dtype=bool) if used is None else used, 3)
    bundle = None if presses is None else PressBundle(presses, unknowns)
    weight = np.where(believed, 1.0 / np.sqrt(variance.ravel()), 0.0)
    iterations = ITERATIONS_TO_COMPARE if to_compare else ITERATIONS
    learned_m = None if presses is None else presses.place_m
    start = np.zeros(len(unknowns.deviation)) if learned_m is None else unknowns.start_at(learned_m)
    scaled, normal = most_probable(unknowns, data, weight, start, bundle, iterations)
    # The covariance is of first order. Its second-order error is added to the deviations of the field.
    curvature = np.zeros(data.size)
    if not to_compare:
        curvature = unknowns.curvature_t(scaled, inverse(normal))
        weight = np.where(believed, 1.0 / root_of_squares(np.sqrt(variance.ravel()), curvature), 0.0)
        scaled, normal = most_probable(unknowns, data, weight, scaled, bundle)
    spread = np.where(believed, np.sqrt(variance.ravel() + square(curvature)), BROKEN_T)
    state, places, matrix = unknowns.unpack(scaled)
    misfit = data - unknowns.predicted(scaled)[0]
    predicted, _ = unknowns.predict(state, places, matrix)
    gain, axes = split(matrix, pad.sensors.axes)
    scaled_covariance = inverse(normal)
    covariance = scaled_covariance * unknowns.deviation[:, None] * unknowns.deviation
    magnet_alone = predicted / gain - SensorArray(places, axes).to_sensor(np.tile(state.ambient_t, (count, 1)))
    distance = lengths(places - state.position_m)
    ambient, ambient_deviation = (None, None) if bare is None else ambient_of(pad, bare)
    place_deviation = np.sqrt(np.diagonal(covariance)[9 : 9 + 3 * count]).reshape(count, 3)
    chi2 = float(np.sum(square(weight * misfit.ravel())) + product(scaled, unknowns.precision, scaled))
    told = np.maximum(1.0 - np.diagonal(scaled_covariance)[:5], TELLS_LITTLE)
    # Learned chips and their magnet may turn together; movements are in the turned axes, so that no tilt is missing.
    of_tilt = told[TILT] if learned_m is None else np.ones(2)
    shared = tolerance.tilts_given((unknowns.deviation * scaled)[TILT] / of_tilt, of_tilt)
    # A misfit that tolerances do not explain widens the pose's deviations in proportion (Birge's ratio: tracker.c).
    birge = max(chi2 / float(believed.sum()), 1.0)
    leftover = Leftover(
        unknowns,
        scaled,
        scaled_covariance,
        np.where(believed, 1.0 / rest.noise_t.ravel(), 0.0),
        of_tilt,
        *shared,
    )
    return Mounting(
        rest=replace(state, ambient_t=np.zeros(3)),
        rest_covariance=birge * covariance[:6, :6],
        gain=gain,
        axes=axes,
        sensor_position_m=places,
        offset_t=rest.mean_t / gain - magnet_alone,
        rest_field_t=magnet_alone,
        noise_t=rest.noise_t,
        sensitivity_deviation=relative_deviation(covariance[9 + 3 * count :, 9 + 3 * count :]),
        place_deviation=_by_place(place_deviation, distance),
        systematic_t=0.0,
        leftover=leftover,
        pad_turn=leftover.pad_turn(),
        chi2=chi2,
        measurements=int(believed.sum()),
        misfit_t=misfit,
        rest_strain=scaled[:5] / np.sqrt(told),
        ambient_t=ambient,
        ambient_deviation_t=ambient_deviation,
        surprise=chi2
        + 2.0 * sum(log(one) for one in spread.tolist())
        + log_determinant(normal)
        - log_determinant(unknowns.precision),
        press_chi2=np.zeros(0) if bundle is None else bundle.linearise(scaled).block_chi2,
    )


def nominal_mounting(pad: Pad, tolerance: Tolerance, bare: Recording, known: Sensitivity) -> Mounting:
    """The mounting as drawn, for a pad whose rest was not recorded yet: only the ambient field is known.

    All sensors have the same weight, as in the paper: only their common tolerance is known.
    """
    shape = bare.mean_t.shape
    at_rest_t = dipole_field(pad.sensors.position_m, pad.rest_position_m, pad.rest_axis, pad.magnet.strength_t_m3)
    typical_t = np.sqrt(np.mean(square(at_rest_t)))
    distance = lengths(pad.sensors.position_m - pad.rest_position_m)
    place = _by_place(np.full(shape, tolerance.sensor_position_m), distance)
    # At a random direction of the field, two of three components are across an axis.
    across = 2.0 * (square(tolerance.sensor_rotation_rad) + square(tolerance.cross_axis))
    gain, uncertain = known.mean[: bare.mean_t.size].reshape(shape), known.covariance[0, 0]  # the same for each gain
    proportional = np.sqrt(uncertain + across + np.mean(square(place)))
    ambient, ambient_deviation = ambient_of(pad, bare)
    return Mounting(
        rest=State.at_rest(pad),
        rest_covariance=np.zeros((6, 6)),
        gain=gain,
        axes=pad.sensors.axes,
        sensor_position_m=pad.sensors.position_m,
        offset_t=bare.mean_t / gain,
        rest_field_t=pad.sensors.to_sensor(at_rest_t),
        noise_t=bare.noise_t,
        sensitivity_deviation=np.zeros((*shape, 3)),
        place_deviation=np.zeros((shape[0], 1)),
        systematic_t=float(proportional * typical_t),
        leftover=None,
        chi2=0.0,
        measurements=0,
        misfit_t=np.zeros(shape),
        rest_strain=np.zeros(5),
        ambient_t=ambient,
        ambient_deviation_t=ambient_deviation,
    )


def ambient_of(pad: Pad, bare: Recording) -> tuple[Array, Array]:
    """The uniform ambient field (3,), and its deviation (3,) from the differences between the sensors."""
    seen = pad.sensors.to_pad(bare.mean_t)
    return seen.mean(axis=0), seen.std(axis=0, ddof=1) / np.sqrt(len(seen))


def _by_place(place_deviation_m: Array, distance_m: Array) -> Array:
    """(N, 1) relative error of a change of the magnet's field: the gradient of a dipole's field goes with 1/r⁴."""
    relative: Array = 4.0 / np.sqrt(3.0) * lengths(place_deviation_m) / distance_m
    return relative[:, None]
