"""Prepares the parameters of hidden_gradient.c, which explains and follows a foreign field without a residual."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import least_squares, length, lengths, product
from fmfts.pad import Pad
from fmfts.pose._alignment import VAGUE_M
from fmfts.pose.kernel import predict
from fmfts.pose.problem import magnet_rows, measurement_rows
from fmfts.pose.state import GRADIENT, POSITION, State

Array = NDArray[np.float64]

# The Earth's field differs by this between two places of a robot's hand, and steel far away adds as much: 1 %.
EVEN_T = 5e-7
# Deviations within which a healthy pad's field is as strong as in its baseline.
HEALTHY = 3.0
NEAREST_M = 0.06
GRADIENT_PER_T = 3.0 / NEAREST_M
# Deviation of the field of what the robot carries, without a turn: a tenth of the Earth's field.
IRON_T = 5e-6


@dataclass(frozen=True, slots=True)
class Reference:
    """field_t (3,): the Earth's field at the baseline; zero where it does not turn, NaN where it is not known.

    iron_t: deviation of other fields in that value, along each axis.
    """

    field_t: Array
    iron_t: float


STANDS_STILL = Reference(np.zeros(3), 0.0)


class HiddenGradient:
    """The effect of such a field on one pad.

    pad: as mounted. ambient_error (8, 3, M): see `Leftover.ambient_error`. effect (5, 5): S, by the components of the
    gradient. even_t: deviation of the ambient field's strength without a foreign field.
    """

    def __init__(
        self,
        pad: Pad,
        rest: State,
        reference: Reference,
        ambient_error: Array,
        effect: Array,
        even_t: float = EVEN_T,
    ) -> None:
        self.reference, self.ambient_error, self.even_t = reference, ambient_error, even_t
        self._effect = effect
        self.unit: Array = square(GRADIENT_PER_T) * product(effect, effect.T)
        # A position that is known no better than VAGUE_M cannot be used (gate.c).
        self.strongest_t = VAGUE_M / float(np.sqrt(np.trace(self.unit[POSITION, POSITION])))

    @property
    def unseen_t(self) -> float:
        """The strongest foreign field that may leave the ambient field as strong as the reference."""
        strength_t = length(self.reference.field_t)
        if not isfinite(strength_t):
            return self.strongest_t
        margin_t = HEALTHY * length(np.array([self.even_t, self.reference.iron_t]))
        return min(float(np.sqrt(margin_t * (2.0 * strength_t + margin_t))), self.strongest_t)

    def unseen_changes(self) -> Array:
        """(10, 5) changes of the pose that each component of such a field's gradient looks like, of both signs."""
        changes: Array = GRADIENT_PER_T * self.unseen_t * np.concatenate([self._effect.T, -self._effect.T])
        return changes


def effect_of_gradient(pad: Pad, rest: State, noise_t: Array, solved: NDArray[np.intp]) -> Array:
    """(5, 5) change of pose that the tracker's least squares make of a gradient's components, at rest.

    pad: as mounted. noise_t (N, 3). solved: the columns that a frame estimates.
    """
    jacobian = _jacobian(pad, rest)
    return _effect(jacobian, jacobian[:, GRADIENT], noise_t, solved)


def effect_of_field(pad: Pad, rest: State, noise_t: Array, solved: NDArray[np.intp]) -> Array:
    """(5, 3N) the same of each value of the field."""
    jacobian = _jacobian(pad, rest)
    return _effect(jacobian, np.eye(len(jacobian)), noise_t, solved)


def _jacobian(pad: Pad, rest: State) -> Array:
    rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, 1.0)
    jacobian: Array = predict(rows, magnet_rows(pad.magnet), rest)[1]
    return jacobian


def _effect(jacobian: Array, fields: Array, noise_t: Array, solved: NDArray[np.intp]) -> Array:
    weight = 1.0 / noise_t.ravel()[:, None]
    seen = weight * jacobian[:, solved]
    scale = lengths(seen.T)
    effect: Array = (least_squares(seen / scale, weight * fields) / scale[:, None])[:5]
    return effect


def reference_of(pad: Pad, ambient_t: Array | None, turned_t: Array | None) -> Reference:
    """The reference of a robot that turns.

    pad: as mounted. ambient_t (N, 3): the field at rest without the magnet's, in sensor axes; None if no recording of
    the bare pad separates it from the magnet's. turned_t (K, N, 3): the same at K orientations, None if there was no
    turn.
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
    # Scales fields in tesla, so that the columns have similar sizes.
    equations = np.column_stack([2.0 * swept, np.full(len(swept), 1e-5)])
    centre: Array = middle + least_squares(equations, square(swept).sum(axis=1))[:3]
    return centre
