"""The uncertainty that a baseline leaves, and its effect on the field and on a change of pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import cholesky, least_squares, lengths, product, singular_values
from fmfts.baseline import sensitivity
from fmfts.baseline.unknowns import AMBIENT_DEVIATION_T, Unknowns
from fmfts.pose import FieldErrors, State
from fmfts.pose.change import pad_turn_of
from fmfts.pose.state import tangent_basis, turned

Array = NDArray[np.float64]

# The change of pose by a firm press, for which the error of a change is computed.
TYPICAL_CHANGE = np.array([3e-4, 3e-4, 5e-4, 0.1, 0.1])
# At most this many independent causes of error are kept for a change of pose: FMFTS_LEFTOVERS in pose/step.h.
MOST_CAUSES = 25
TILT, AMBIENT_COLUMNS = slice(3, 5), np.arange(6, 9)
TELLS_LITTLE = 1e-2  # the share of a tolerance's variance below which a recording does not determine a distance
# A finger presses down; sideways and in tilt it may move either way.
HALF_A_PRESS = np.array([0.0, 0.0, -3e-4, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Leftover:
    """The baseline's uncertainty: the estimate `scaled` (M,) of the unknowns, and its covariance (M, M).

    weight: (3N,) of the field values of a frame. told_of_tilt (2,): how much of a tilt the most probable one has, on
    average; the chips have the rest, as a common rotation. pad_share: how much of the tilt is the whole pad's;
    unshared_tilt_rad: deviation of the pad's tilt if the magnet's is known.
    """

    unknowns: Unknowns
    scaled: Array
    covariance: Array
    weight: Array
    told_of_tilt: Array
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

        After the columns of the M unknowns there is one for the tracker's dipole in place of the cylinder.
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
        """See `Mounting.pad_turn`."""
        drawn, tilt = self.unknowns.pad.rest_axis, (self.unknowns.deviation * self.scaled)[TILT] / self.told_of_tilt
        return pad_turn_of(turned(drawn, tilt), drawn, self.pad_share)

    def _errors_of_tilt(self) -> Array:
        """The error (3, 3, M + 2) of a unit movement along each axis, by each deviation of unknowns and of the pad's
        tilt.
        """
        axis = self.unknowns.pad.rest_axis
        root = self._root[TILT] / np.sqrt(self.told_of_tilt)[:, None]
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


def fewest_causes(errors: Array) -> Array:
    """(R, ≤ MOST_CAUSES) errors of other causes, with the covariance of `errors` (R, M), but for the least."""
    if errors.shape[1] <= MOST_CAUSES:
        return errors
    _, size, directions = singular_values(errors.T)
    return np.asarray((directions * size)[:, :MOST_CAUSES], dtype=np.float64)


def _around_half_a_press(rest: State) -> Iterator[tuple[State, State]]:
    """For each direction of the pose, the states half a typical change before and after half a press.

    For a quadratic that is zero at rest, the derivative half way times the change is exact, also in second order.
    """
    for direction, size in enumerate(TYPICAL_CHANGE):
        step = np.zeros(5)
        step[direction] = size / 2.0
        yield rest.stepped(HALF_A_PRESS - step), rest.stepped(HALF_A_PRESS + step)
