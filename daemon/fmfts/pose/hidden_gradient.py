"""What a foreign field that no residual shows adds to the uncertainty of a change of pose.

Where the ambient field is estimated, a foreign field's uniform part is taken for it. Of its gradient's five components
the four sensors around a magnet see two: xx + yy is to them a change of height, xz and yz a shift with a tilt. So a
magnet on a tool can look like a press, without a residual. Its uniform part betrays it: the Earth's field turns with
the robot, but keeps its strength; where the robot stands still, it keeps its direction, too. So

    strange = |reference + change| − |reference|         (reference: the ambient field of the baseline, or 0)
    σ² = EVEN_T² + b̂ᵀCb̂ + Σₘ (b̂·eₘ)²                    (b̂: direction of reference + change)
    foreign² = max(strange² − (HEALTHY·σ)², 0)

with C the change's covariance, and eₘ the errors that the baseline leaves. A dipole r away whose field is b has
gradients of 3b/r; NEAREST_M is the smallest r at which no residual would show it. S is what the solver makes of a
gradient:

    covariance of the change of pose += (3·foreign/NEAREST_M)²·SSᵀ
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import least_squares, length, lengths, product
from fmfts.pad import Pad
from fmfts.pose.change import widened
from fmfts.pose.field_errors import change_since
from fmfts.pose.gate import VAGUE_M
from fmfts.pose.model import predict
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


class HiddenGradient:
    """Follows the strength of one pad's ambient field.

    reference_t (3,): the ambient field at the baseline, zero where it does not turn, NaN where it is not known.
    ambient_error (8, 3, M): see `Leftover.ambient_error`. effect (5, 5): S, by the components of the gradient.
    """

    def __init__(self, rest: State, reference_t: Array, ambient_error: Array, effect: Array) -> None:
        self._rest, self.reference_t, self.ambient_error = rest, reference_t, ambient_error
        self.unit: Array = square(GRADIENT_PER_T) * product(effect, effect.T)
        # A position that is known no better than VAGUE_M cannot be used (gate.py).
        self.strongest_t = VAGUE_M / float(np.sqrt(np.trace(self.unit[POSITION, POSITION])))
        self._strength_t = length(reference_t)
        self._error_rows = ambient_error.reshape(8, -1)
        self.memory = HiddenGradientMemory()

    def judge(self, track: Track, elapsed_s: float) -> Track:
        """Note a frame. Returns `track`, its covariance widened; `disturbed` if the foreign field is too strong."""
        if track.estimate is None:
            return track
        memory, state = self.memory, track.estimate.state
        faded_t = memory.foreign_t * FADES_S / (FADES_S + elapsed_s)
        change, covariance = change_since(self._rest, state), track.estimate.covariance[AMBIENT, AMBIENT]
        memory.foreign_t = max(self._foreign_t(change, covariance), faded_t)
        if memory.foreign_t > self.strongest_t:
            return Track(None, track.used, "disturbed", self._reason(state.ambient_t))
        return replace(track, estimate=self.widened(track.estimate))

    def widened(self, estimate: PoseEstimate) -> PoseEstimate:
        """The estimate with what the foreign field leaves uncertain of it."""
        if self.memory.foreign_t == 0.0:
            return estimate
        return widened(estimate, self._rest, square(self.memory.foreign_t) * self.unit)

    def _stronger(self, ambient_t: Array) -> float:
        """How much (T) a change (3,) of the ambient field since the baseline has made it stronger."""
        return length(self.reference_t + ambient_t) - self._strength_t

    def _reason(self, ambient_t: Array) -> str:
        """Why a frame with this change (3,) of the ambient field cannot be used."""
        if not self._strength_t:
            return FOREIGN.format(f"has changed by {length(ambient_t) * 1e7:.0f} mG")
        share = self._stronger(ambient_t) / self._strength_t
        return FOREIGN.format(f"is {abs(share):.0%} {'stronger' if share > 0.0 else 'weaker'}")

    def _foreign_t(self, change: Array, covariance: Array) -> float:
        strange_t = self._stronger(change[5:])
        if not abs(strange_t) > HEALTHY * EVEN_T:  # also where the reference is not known
            return 0.0
        total_t = self.reference_t + change[5:]
        direction = total_t / length(total_t)
        error = product(direction, product(change, self._error_rows).reshape(3, -1))
        variance = square(EVEN_T) + float(product(direction, covariance, direction)) + float(product(error, error))
        return float(np.sqrt(max(square(strange_t) - square(HEALTHY) * variance, 0.0)))


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


def reference_of(pad: Pad, offset_t: Array, turns: bool, is_known: bool) -> Array:
    """(3,) the reference. offset_t (N, 3): the field at rest without the magnet's, in sensor axes."""
    if not turns:
        return np.zeros(3)
    return np.asarray(pad.sensors.to_pad(offset_t).mean(axis=0) if is_known else np.full(3, np.nan))
