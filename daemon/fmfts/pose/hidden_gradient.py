"""What a foreign field that no residual shows adds to the uncertainty of a change of pose.

Where the ambient field is estimated, a foreign field's uniform part is taken for it. Of its gradient's five components
the four sensors around a magnet see two: xx + yy is to them a change of height, xz and yz a shift with a tilt. So a
magnet on a tool can look like a press, without a residual. Its uniform part betrays it: the Earth's field turns with
the robot, but keeps its strength; where the robot stands still, it keeps its direction, too. So

    strange = |reference + change| − |reference|         (reference: the Earth's field at the baseline, or 0)
    σ² = EVEN_T² + b̂ᵀCb̂ + Σₘ (b̂·eₘ)² + iron²·|b̂ − b̂₀|²  (b̂, b̂₀: directions of reference + change, of reference)
    foreign² = max(strange² − (HEALTHY·σ)², 0)

with C the change's covariance, and eₘ the errors that the baseline leaves. iron: a magnet that turns along (motors, the
robot's screws) is in the reference, but is none of the Earth's; a turn of the robot measures it. A dipole r away whose
field is b has gradients of 3b/r; NEAREST_M is the smallest r at which no residual would show it. S is what the solver
makes of a gradient:

    covariance of the change of pose += (3·foreign/NEAREST_M)²·SSᵀ

A foreign field at a right angle to the Earth's leaves its strength as it is, and a smaller one is within HEALTHY·σ: see
`unseen_t`. Where the scene has steel nearby, no contact is certain below the force that such a field looks like.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import least_squares, length, lengths, product
from fmfts.pad import Pad
from fmfts.pose.change import widened
from fmfts.pose.field_errors import change_since
from fmfts.pose.gate import VAGUE_M
from fmfts.pose.model import predict
from fmfts.pose.neighbour import NeighbourEstimate
from fmfts.pose.problem import magnet_rows, measurement_rows
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import AMBIENT, GRADIENT, POSITION, State
from fmfts.pose.track import Track

Array = NDArray[np.float64]

# The Earth's field differs by this between two places of a robot's hand, and steel far away adds as much: 1 %.
EVEN_T = 5e-7
# In so many deviations, a healthy pad's field is as strong as in its baseline.
HEALTHY = 3.0
NEAREST_M = 0.06
GRADIENT_PER_T = 3.0 / NEAREST_M
# What the robot carries and nobody has measured: unknown by a tenth of the Earth's field.
IRON_T = 5e-6
# A tool that passes turns its field: for moments it is as strong as the Earth's alone. What was seen fades slowly.
FADES_S = 1.0


FOREIGN = (
    "the ambient field {} since the baseline: a magnet or steel is near, which may look like a touch; "
    "where this is its place for good, record the baseline again"
)


@dataclass(slots=True)
class HiddenGradientMemory:
    """foreign_t: the foreign field that was seen, faded since."""

    foreign_t: float = 0.0


@dataclass(frozen=True, slots=True)
class Reference:
    """field_t (3,): the Earth's field at the baseline; zero where it does not turn, NaN where it is not known.

    iron_t: deviation of what else the baseline has taken for it, along each axis.
    """

    field_t: Array
    iron_t: float


STANDS_STILL = Reference(np.zeros(3), 0.0)


class HiddenGradient:
    """Follows the strength of one pad's ambient field.

    pad: as mounted. ambient_error (8, 3, M): see `Leftover.ambient_error`. effect (5, 5): S, by the components of the
    gradient.
    """

    def __init__(self, pad: Pad, rest: State, reference: Reference, ambient_error: Array, effect: Array) -> None:
        self._pad, self._rest, self.reference, self.ambient_error = pad, rest, reference, ambient_error
        self._effect = effect
        self.unit: Array = square(GRADIENT_PER_T) * product(effect, effect.T)
        # A position that is known no better than VAGUE_M cannot be used (gate.py).
        self.strongest_t = VAGUE_M / float(np.sqrt(np.trace(self.unit[POSITION, POSITION])))
        self._error_rows = ambient_error.reshape(8, -1)
        self.memory = HiddenGradientMemory()

    @property
    def unseen_t(self) -> float:
        """The strongest foreign field that may leave the ambient field as strong as the reference."""
        strength_t = length(self.reference.field_t)
        if not isfinite(strength_t):
            return self.strongest_t
        margin_t = HEALTHY * length(np.array([EVEN_T, self.reference.iron_t]))
        return min(float(np.sqrt(margin_t * (2.0 * strength_t + margin_t))), self.strongest_t)

    def unseen_changes(self) -> Array:
        """(10, 5) changes of the pose that each component of such a field's gradient looks like, of both signs."""
        changes: Array = GRADIENT_PER_T * self.unseen_t * np.concatenate([self._effect.T, -self._effect.T])
        return changes

    def judge(self, track: Track, elapsed_s: float, neighbours: Sequence[NeighbourEstimate] = ()) -> Track:
        """Note a frame. Returns `track`, its covariance widened; `disturbed` if the foreign field is too strong."""
        if track.estimate is None:
            return track
        memory, state = self.memory, track.estimate.state
        reference_t = self._reference_t(neighbours)
        faded_t = memory.foreign_t * FADES_S / (FADES_S + elapsed_s)
        change, covariance = change_since(self._rest, state), track.estimate.covariance[AMBIENT, AMBIENT]
        memory.foreign_t = max(self._foreign_t(reference_t, change, covariance), faded_t)
        if memory.foreign_t > self.strongest_t:
            return Track(None, track.used, "disturbed", _reason(reference_t, state.ambient_t))
        return replace(track, estimate=self.widened(track.estimate))

    def widened(self, estimate: PoseEstimate) -> PoseEstimate:
        """The estimate with what the foreign field leaves uncertain of it."""
        if self.memory.foreign_t == 0.0:
            return estimate
        return widened(estimate, self._rest, square(self.memory.foreign_t) * self.unit)

    def _reference_t(self, neighbours: Sequence[NeighbourEstimate]) -> Array:
        """(3,) the reference. A neighbour turns along: the bare recording has taken its field for the Earth's."""
        reference_t, sensors = self.reference.field_t, self._pad.sensors
        if self.reference.iron_t > 0.0:
            for other in neighbours:
                reference_t = reference_t - sensors.to_pad(other.field(sensors, other.rest)).mean(axis=0)
        return reference_t

    def _foreign_t(self, reference_t: Array, change: Array, covariance: Array) -> float:
        total_t = reference_t + change[5:]
        strength_t, before_t = length(total_t), length(reference_t)
        strange_t = strength_t - before_t
        if not abs(strange_t) > HEALTHY * EVEN_T:  # also where the reference is not known
            return 0.0
        direction = total_t / strength_t
        error = product(direction, product(change, self._error_rows).reshape(3, -1))
        variance = square(EVEN_T) + float(product(direction, covariance, direction)) + float(product(error, error))
        if self.reference.iron_t > 0.0:
            turned = direction - reference_t / before_t
            variance += square(self.reference.iron_t) * float(product(turned, turned))
        return float(np.sqrt(max(square(strange_t) - square(HEALTHY) * variance, 0.0)))


def _reason(reference_t: Array, ambient_t: Array) -> str:
    """Why a frame with this change (3,) of the ambient field cannot be used."""
    strength_t = length(reference_t)
    if strength_t == 0.0:
        return FOREIGN.format(f"has changed by {length(ambient_t) * 1e7:.0f} mG")
    share = length(reference_t + ambient_t) / strength_t - 1.0
    return FOREIGN.format(f"is {abs(share):.0%} {'stronger' if share > 0.0 else 'weaker'}")


def effect_of_gradient(pad: Pad, rest: State, noise_t: Array, solved: NDArray[np.intp]) -> Array:
    """(5, 5) change of pose that the tracker's least squares make of a gradient's components, at rest.

    pad: as mounted. noise_t (N, 3). solved: the columns that a frame estimates.
    """
    rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, 1.0)
    _, jacobian = predict(rows, magnet_rows(pad.magnet), rest)
    weight = 1.0 / noise_t.ravel()[:, None]
    seen = weight * jacobian[:, solved]
    scale = lengths(seen.T)
    effect: Array = (least_squares(seen / scale, weight * jacobian[:, GRADIENT]) / scale[:, None])[:5]
    return effect


def reference_of(pad: Pad, ambient_t: Array | None, turned_t: Array | None) -> Reference:
    """The reference of a robot that turns.

    pad: as mounted. ambient_t (N, 3): the field at rest without the magnet's, in sensor axes; None if no recording of
    the bare pad tells it from the magnet's. turned_t (K, N, 3): the same at K orientations, None if there was no turn.
    """
    nothing = Reference(np.full(3, np.nan), 0.0)
    if ambient_t is None:
        return nothing
    here_t: Array = pad.sensors.to_pad(ambient_t).mean(axis=0)
    if turned_t is None:
        return Reference(here_t, IRON_T)
    return Reference(here_t - centre_of(pad.sensors.to_pad(turned_t).mean(axis=1)), 0.0)


def centre_of(points: Array) -> Array:
    """(3,) the centre c of the sphere through points p (K, 3): |p − c|² is the same for all, linear in c and |c|²."""
    middle = points.mean(axis=0)
    swept = points - middle
    # Fields in tesla: with this the columns are of one size.
    equations = np.column_stack([2.0 * swept, np.full(len(swept), 1e-5)])
    centre: Array = middle + least_squares(equations, square(swept).sum(axis=1))[:3]
    return centre
