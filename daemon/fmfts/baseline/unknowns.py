"""The unknowns of mounting and manufacture as one vector, and their effect on the field and on a change of pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import cholesky, inverse, least_squares, lengths, product, singular_values
from fmfts.baseline import sensitivity
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.pad import Pad, Tolerance
from fmfts.pose import FieldErrors, State, dipole_derivatives, octupole_m2
from fmfts.pose.change import pad_turn_of
from fmfts.pose.state import tangent_basis, turn_derivative, turned

Array = NDArray[np.float64]

# The Earth's field has 0.25–0.65 G in an unknown direction; steel in a robot's arm adds to it.
AMBIENT_DEVIATION_T = 5e-5
# The change of the ambient field between two recordings while the robot stands still.
STANDING_AMBIENT_T = 1e-7
# The change of pose by a firm press, for which the error of a change is computed.
TYPICAL_CHANGE = np.array([3e-4, 3e-4, 5e-4, 0.1, 0.1])
# A smaller variance of a sensitivity is none: of a tolerance of zero.
EXACT = 1e-15
# Of so many independent causes the errors of a change are kept: FMFTS_LEFTOVERS in pose/step.h.
MOST_CAUSES = 25
TILT, AMBIENT_COLUMNS = slice(3, 5), np.arange(6, 9)
TELLS_LITTLE = 1e-2  # the share of a tolerance's variance below which a recording tells nothing of a distance
# A finger presses down; sideways and in tilt it may move either way.
HALF_A_PRESS = np.array([0.0, 0.0, -3e-4, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Rest pose and log moment (6), ambient field (3), sensor places (3N), sensitivities (9N), in prior deviations from
    the drawing and from the prior's `sensitivity` (9N,). deviation (9 + 12N,): the prior deviations in SI. precision
    (9 + 12N, 9 + 12N): of the prior in these units; after a turn of the robot the sensitivities are correlated."""

    pad: Pad
    deviation: Array
    sensitivity: Array
    precision: Array

    @classmethod
    def of(cls, pad: Pad, tolerance: Tolerance, ambient_free: bool, measured: Sensitivity | None = None) -> Unknowns:
        """ambient_free: the ambient field is unknown; else only its change since a bare recording is.

        measured: the sensitivities, None: only their tolerances are known. What has no tolerance counts as exact.
        """
        count = len(pad.sensors)
        known = measured or Sensitivity.untested(count, tolerance)
        free = np.flatnonzero(np.diagonal(known.covariance) > EXACT)
        sensitivity_deviation = np.zeros(9 * count)
        sensitivity_deviation[free] = np.sqrt(np.diagonal(known.covariance))[free]
        precision = np.eye(9 + 12 * count)
        if len(free):
            scale, places = sensitivity_deviation[free], 9 + 3 * count + free
            precision[np.ix_(places, places)] = inverse(known.covariance[np.ix_(free, free)] / scale / scale[:, None])
        spread = np.concatenate(
            [
                np.full(3, tolerance.magnet_position_m),
                np.full(2, tolerance.tilt_rad),
                [tolerance.remanence],
                np.full(3, AMBIENT_DEVIATION_T if ambient_free else STANDING_AMBIENT_T),
                np.full(3 * count, tolerance.sensor_position_m),
                sensitivity_deviation,
            ]
        )
        return cls(pad, spread, known.mean, precision)

    def unpack(self, scaled: Array) -> tuple[State, Array, Array]:
        """State, sensor places (N, 3) and sensitivity matrices (N, 3, 3)."""
        count = len(self.pad.sensors)
        values = self.deviation * scaled
        places = self.pad.sensors.position_m + values[9 : 9 + 3 * count].reshape(count, 3)
        matrix = sensitivity.matrices(self.sensitivity + values[9 + 3 * count :])
        return State.at_rest(self.pad).stepped(values[:9]), places, matrix

    def start_at(self, place_m: Array) -> Array:
        """The vector (M,) of sensors at `place_m` (N, 3) that are turned as drawn; all else is as expected."""
        offset = np.zeros(len(self.deviation))
        first, count = 9, place_m.size
        offset[first : first + count] = (place_m - self.pad.sensors.position_m).ravel()
        offset[first + 2 * count : first + 3 * count] = -self.sensitivity[count : 2 * count]
        exact = self.deviation == 0.0
        scaled: Array = np.where(exact, 0.0, offset / np.where(exact, 1.0, self.deviation))
        return scaled

    @property
    def cylinder_m2(self) -> float:
        """κ of the real magnet, even if the tracker uses a dipole."""
        return octupole_m2(self.pad.magnet)

    @property
    def model_deviation_t(self) -> float:
        """The part of the cylinder's field that `predict` leaves out, at the nearest sensor."""
        away = lengths(self.pad.sensors.position_m - self.pad.rest_position_m)
        return self.pad.magnet.beyond_octupole_t(float(away.min()))

    def curvature_t(self, scaled: Array, covariance: Array) -> Array:
        """(3N,) rms of the second-order part of each field value around `scaled`, over errors with `covariance` (M, M).

        With H the second derivatives by independent errors of deviation one, the mean is ½ tr H, the variance ½ tr H².
        """
        root = cholesky(covariance)
        here = self.predict(*self.unpack(scaled), octupole_m2=self.cylinder_m2)[1]
        bent = np.array(
            [
                product(
                    self.predict(*self.unpack(scaled + error), octupole_m2=self.cylinder_m2)[1] - here,
                    self.deviation[:, None] * root,
                )
                for error in root.T
            ]
        )
        mean, variance = np.trace(bent, axis1=0, axis2=2) / 2.0, square(bent).sum(axis=(0, 2)) / 2.0
        return np.asarray(np.sqrt(square(mean) + variance), dtype=np.float64)

    def predict(
        self,
        state: State,
        places: Array,
        matrix: Array,
        start_axis: Array | None = None,
        octupole_m2: float | None = None,
    ) -> tuple[Array, Array]:
        """Field (N, 3) as the chips report it, and its Jacobian (3N, 9 + 12N) in SI.

        matrix (N, 3, 3): sensitivities. octupole_m2: κ of the magnet, None: the tracker's. The tilt is a step in the
        tangent plane of `start_axis`, None: of the drawing's axis, from which the search for the rest pose starts.
        """
        start_axis = self.pad.rest_axis if start_axis is None else start_axis
        count = len(places)
        strength = self.pad.magnet.strength_t_m3 * exp(state.log_moment)
        octupole_m2 = self.pad.magnet.modelled_octupole_m2 if octupole_m2 is None else octupole_m2
        dipole, by_position, by_axis = dipole_derivatives(places, state.position_m, state.axis, strength, octupole_m2)
        to_sensor = self.pad.sensors.axes.transpose(0, 2, 1)
        field = (product(to_sensor, (dipole + state.ambient_t)[:, :, None]))[:, :, 0]
        columns = np.zeros((count, 3, len(self.deviation)))
        columns[:, :, 0:3] = product(to_sensor, by_position)
        columns[:, :, 3:5] = product(to_sensor, by_axis, turn_derivative(start_axis, state.axis))
        columns[:, :, 5] = (product(to_sensor, dipole[:, :, None]))[:, :, 0]
        columns[:, :, 6:9] = to_sensor
        for sensor in range(count):
            columns[sensor, :, 9 + 3 * sensor : 12 + 3 * sensor] = product(-to_sensor[sensor], by_position[sensor])
        columns = product(matrix, columns)
        columns[:, :, 9 + 3 * count :] = sensitivity.columns(field)
        return product(matrix, field[:, :, None])[:, :, 0], columns.reshape(3 * count, -1)


@dataclass(frozen=True, slots=True)
class Leftover:
    """What the baseline leaves uncertain: the estimate `scaled` (M,) of the unknowns, and its covariance (M, M).

    weight: (3N,) of the field values of a frame. pad_share: how much of the magnet's tilt is the whole pad's;
    unshared_tilt_rad: what of the pad's tilt stays unknown where the magnet's is known.
    """

    unknowns: Unknowns
    scaled: Array
    covariance: Array
    weight: Array
    pad_share: float = 0.0
    unshared_tilt_rad: float = 0.0

    @property
    def _root(self) -> Array:
        return np.asarray(self.unknowns.deviation[:, None] * cholesky(self.covariance), dtype=np.float64)

    @property
    def sensitivity_deviation(self) -> Array:
        """(9N,) standard deviations of the sensitivities."""
        first = len(self.scaled) - len(self.unknowns.sensitivity)
        deviation: Array = (np.sqrt(np.diagonal(self.covariance)) * self.unknowns.deviation)[first:]
        return deviation

    def field_errors(self) -> FieldErrors:
        """The errors of the field, after a change of pose and of the ambient field, that these uncertainties cause.

        Besides the columns of the M unknowns there is one for the tracker's use of a dipole in place of the cylinder.
        """
        state, places, matrix = self.unknowns.unpack(self.scaled)
        state = replace(state, ambient_t=np.zeros(3))
        gain, root, kappa = lengths(matrix).reshape(-1, 1), self._root, self.unknowns.cylinder_m2
        by_pose = np.empty((5, gain.size, len(self.scaled) + 1))
        for direction, (less, more) in enumerate(_around_half_a_press(state)):
            mistaken = product(
                self.unknowns.predict(more, places, matrix)[1] - self.unknowns.predict(less, places, matrix)[1], root
            )
            cylinder = self._cylinder(more, places, matrix, kappa) - self._cylinder(less, places, matrix, kappa)
            by_pose[direction] = np.hstack([mistaken, cylinder.reshape(-1, 1)]) / gain / TYPICAL_CHANGE[direction]
        return FieldErrors(
            by_pose, np.concatenate([self._by_field(root), np.zeros((gain.size, 3, 1))], axis=2) / gain[:, :, None]
        )

    def _by_field(self, root: Array) -> Array:
        """(3N, 3, M) errors of the reported values per ambient field along the axes of the pad."""
        count = len(self.unknowns.pad.sensors)
        by_own_axes = sensitivity.matrices(root[9 + 3 * count :]).reshape(count, 3, 3, -1)
        turned = product(self.unknowns.pad.sensors.axes[:, None], by_own_axes)
        return np.asarray(turned.reshape(3 * count, 3, -1), dtype=np.float64)

    def _cylinder(self, state: State, places: Array, matrix: Array, octupole_m2: float) -> Array:
        """(N, 3) the cylinder's field minus that of the tracker's model."""
        whole, _ = self.unknowns.predict(state, places, matrix, octupole_m2=octupole_m2)
        modelled, _ = self.unknowns.predict(state, places, matrix)
        return whole - modelled

    def change_error(self, solved: NDArray[np.intp]) -> Array:
        """(8, 5, M): for a unit change of the pose along each of its five directions, and of the ambient field along
        each axis, the error (5,) of the change of pose that each of M independent deviations causes; M is at most 25.

        At rest the baseline absorbs the errors of places and sensitivities. In a changed pose they have another effect:
        the difference of the field's derivatives there and at rest; and another ambient field is read by chips that are
        turned. The tracker's least squares turn both into an error of pose; its unknowns are the columns `solved` (pose
        0–4, log moment 5, ambient field 6–8). Where the ambient field is not solved, it does not change.

        A pad whose own tilt is not known turns the movement of its magnet by that, too.
        """
        # In these units a typical error is one, whichever change causes it.
        typical = np.append(TYPICAL_CHANGE, np.full(3, AMBIENT_DEVIATION_T))[:, None] / TYPICAL_CHANGE
        errors = np.concatenate([self._errors_of_change(solved)[:, :5], np.zeros((8, 5, 2))], axis=2)
        errors[:3, :3] += self._errors_of_tilt()
        relative = fewest_causes((errors * typical[:, :, None]).reshape(40, -1)).reshape(8, 5, -1)
        return np.asarray(relative / typical[:, :, None], dtype=np.float64)

    def pad_turn(self) -> Array:
        """See `Mounting.pad_turn`. The most probable tilt is too small: chips that are all turned look like a tilt, and
        a part of it is put down to them. That part is given back."""
        drawn, tilt = (
            self.unknowns.pad.rest_axis,
            self.unknowns.deviation[TILT] * self.scaled[TILT] / self._told_of_tilt,
        )
        return pad_turn_of(turned(drawn, tilt), drawn, self.pad_share)

    @property
    def _told_of_tilt(self) -> Array:
        """(2,) how much of a tilt the most probable one has, on average."""
        told: Array = np.maximum(1.0 - np.diagonal(self.covariance)[TILT], TELLS_LITTLE)
        return told

    def _errors_of_tilt(self) -> Array:
        """(3, 3, M + 2): of a unit movement along each axis, by each deviation of unknowns and of the pad's tilt."""
        axis = self.unknowns.pad.rest_axis
        root = self._root[TILT] / np.sqrt(self._told_of_tilt)[:, None]
        tilts = np.hstack([self.pad_share * root, self.unshared_tilt_rad * np.eye(2)])
        (a, b, c), (u, v, w) = axis, product(tangent_basis(axis), tilts)
        x, y, z = b * w - c * v, c * u - a * w, a * v - b * u  # the turn: axis × movement of its end
        zero = np.zeros(len(x))
        return np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]])

    def ambient_error(self, solved: NDArray[np.intp]) -> Array:
        """(8, 3, M) as `change_error`, the error of the change of the ambient field; M = 0 where it is not solved."""
        if not np.isin(AMBIENT_COLUMNS, solved).all():
            return np.zeros((8, 3, 0))
        typical = np.append(TYPICAL_CHANGE, np.full(3, AMBIENT_DEVIATION_T))[:, None, None]
        errors = self._errors_of_change(solved)[:, np.searchsorted(solved, AMBIENT_COLUMNS)]
        return np.asarray(fewest_causes((errors * typical).reshape(24, -1)).reshape(8, 3, -1) / typical)

    def _errors_of_change(self, solved: NDArray[np.intp]) -> Array:
        """(8, len(solved), M) errors of the solved columns, for each change and each deviation of the unknowns."""
        state, places, matrix = self.unknowns.unpack(self.scaled)
        _, at_rest = self.unknowns.predict(state, places, matrix)
        root = self._root
        errors = np.zeros((8, len(solved), len(self.scaled)))
        for direction, size in enumerate(TYPICAL_CHANGE):
            step = np.zeros(9)
            step[direction] = size
            _, there = self.unknowns.predict(state.stepped(step), places, matrix)
            seen = self.weight[:, None] * there[:, solved]
            scale = lengths(seen.T)
            mistaken = product(self.weight[:, None] * (there - at_rest), root)
            errors[direction] = least_squares(seen / scale, mistaken) / scale[:, None] / size
        if np.isin(AMBIENT_COLUMNS, solved).all():
            by_field = self.weight[:, None, None] * self._by_field(root)
            seen = self.weight[:, None] * at_rest[:, solved]
            scale = lengths(seen.T)
            for axis in range(3):
                errors[5 + axis] = least_squares(seen / scale, by_field[:, axis]) / scale[:, None]
        return errors


def fewest_causes(errors: Array, most: int = MOST_CAUSES) -> Array:
    """(R, ≤ most) errors of other independent causes, with the covariance of `errors` (R, M), but for the least."""
    if errors.shape[1] <= most:
        return errors
    _, size, directions = singular_values(errors.T)
    return np.asarray((directions * size)[:, :most], dtype=np.float64)


def _around_half_a_press(rest: State) -> Iterator[tuple[State, State]]:
    """For each direction of the pose, the states half a typical change before and after half a press.

    For a quadratic that is zero at rest, the derivative half way times the change is exact, also in second order.
    """
    for direction, size in enumerate(TYPICAL_CHANGE):
        step = np.zeros(5)
        step[direction] = size / 2.0
        yield rest.stepped(HALF_A_PRESS - step), rest.stepped(HALF_A_PRESS + step)
