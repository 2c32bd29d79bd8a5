"""The field that a hand's own steel, motors and magnets make at an untouched pad, as a function of its joints.

    u = A (q − q₀)                joints to a few coordinates, each −1 … 1 over what was taught
    f = (φ(u) − φ(u_rest)) W      φ: products of Chebyshev polynomials of u

f is the change since the rest recording, without its even part, which the ambient field of the scene explains. Its
errors are a covariance over all values:

    C = (1 + φᵀN⁻¹φ) S + s² f fᵀ + Σᵢ σᵢ² ∂f/∂uᵢ ∂f/∂uᵢᵀ + d² |f|² 1

S: what left-out parts of the recording showed. N: normal matrix of W. s: share by which magnets become stronger or
nearer; σᵢ: play of a joint; d: difference between days. The last three are larger if the rest is of another day.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fmfts.arithmetic.matrix import product
from fmfts.pad import Array
from fmfts.pose import _alignment

# s, σ and d within a day, and between two recordings of a LEAP hand (two recordings, four skins: lab/results/real.md).
SCALE, OTHER_SCALE = 0.03, 0.7
PLAY_RAD, OTHER_PLAY_RAD = 0.005, 0.035
UNLIKE, OTHER_UNLIKE = 0.02, 0.07
OTHER_SPREAD = 1.5  # factor of the deviation over all postures
# A posture farther than this from all recorded ones, as a share of their half range, is unknown.
BEYOND = 0.25
REST_UNKNOWN = _alignment.posture(_alignment.POSTURE_NO_REST, 0.0)[-1]
# Factor by which a joint may deviate more from the recorded surface than in the recording.
OFF_RAD = 0.05
# Outside the recorded postures: factor of the field's deviation over all of them.
UNTAUGHT = 2.0


class Predicted(NamedTuple):
    """field_t (P,): change of the field since rest. covariance_t2 (P, P): of its errors. why: reason if the joints
    do not determine it, else empty."""

    field_t: Array
    covariance_t2: Array
    why: str = ""


@dataclass(frozen=True)
class PostureModel:
    """names: the joints (J). middle_rad, off_rad (J,): see `coordinates`. axes (m, J): A. exponents (T, m): of φ.

    weight_t (T, P): W. inverse_normal (T, T). left_t2 (P, P): S. mean_t (P,), spread_t2 (P, P): over the postures that
    were taught. rest_rad (J,): the joints of the rest recording, if it is newer than the posture; else None.
    rest_unknown: it is newer, and its joints are not known.
    """

    names: tuple[str, ...]
    middle_rad: Array
    off_rad: Array
    axes: Array
    exponents: Array
    weight_t: Array
    inverse_normal: Array
    left_t2: Array
    mean_t: Array
    spread_t2: Array
    rest_rad: Array | None = None
    rest_unknown: bool = False

    @property
    def of_another_day(self) -> bool:
        return self.rest_rad is not None or self.rest_unknown

    def predicted(self, position_rad: Array | None) -> Predicted:
        """The field at joints (J,); None: unknown."""
        if not self.names:
            return self._anywhere(1.0, "")
        if position_rad is None or self.rest_unknown or not len(self.axes):
            return self._anywhere(1.0, REST_UNKNOWN)
        coordinates, why = self.coordinates(position_rad)
        if why:
            return self._anywhere(UNTAUGHT, why)
        taught = np.minimum(np.maximum(coordinates, -1.0), 1.0)
        basis, slopes = _basis(self.exponents, taught)
        field_t = product(basis - self._rest_basis(), self.weight_t)
        scale, play_rad, unlike = (
            (OTHER_SCALE, OTHER_PLAY_RAD, OTHER_UNLIKE) if self.of_another_day else (SCALE, PLAY_RAD, UNLIKE)
        )
        play = play_rad * np.sqrt((self.axes * self.axes).sum(axis=1)) + np.abs(coordinates - taught)
        columns = [scale * field_t, *(play[:, None] * product(slopes, self.weight_t))]
        common = np.stack(columns, axis=1)
        even = unlike * unlike * product(field_t, field_t) / len(field_t)
        known = 1.0 + product(basis, self.inverse_normal, basis)
        covariance = known * self.left_t2 + product(common, common.T) + even * np.eye(len(field_t))
        return Predicted(field_t, covariance)

    def coordinates(self, position_rad: Array) -> tuple[Array, str]:
        """u (m,), and why this is not a recorded posture; "" if it is."""
        from_middle = position_rad - self.middle_rad
        coordinates: Array = product(self.axes, from_middle)
        size = (self.axes * self.axes).sum(axis=1)
        off = np.abs(from_middle - product(self.axes.T, coordinates / size))
        if (off > self.off_rad + OFF_RAD).any():
            joint = self.names[int(np.argmax(off - self.off_rad))]
            return coordinates, f"joint '{joint}' is {off.max():.2f} rad away from all postures that were taught"
        beyond = np.abs(coordinates) - 1.0
        if (beyond > BEYOND).any():
            return coordinates, "the hand is bent further than it was while its posture was taught"
        return coordinates, ""

    def _rest_basis(self) -> Array:
        """φ(u_rest), or zero if the fields were recorded as changes from this rest."""
        if self.rest_rad is None:
            return np.zeros(len(self.exponents))
        coordinates, _ = self.coordinates(self.rest_rad)
        return _basis(self.exponents, np.minimum(np.maximum(coordinates, -1.0), 1.0))[0]

    def _anywhere(self, more: float, why: str) -> Predicted:
        """The field in any of the recorded postures."""
        mean_t, spread_t2 = self.mean_t, self.spread_t2
        if self.rest_rad is not None:
            mean_t = mean_t - product(self._rest_basis(), self.weight_t)
        elif self.rest_unknown:
            mean_t, more = np.zeros(len(mean_t)), more * float(np.sqrt(2.0))
        if self.of_another_day:
            more *= OTHER_SPREAD
        return Predicted(mean_t, more * more * spread_t2 + self.left_t2, why)


def basis_of(exponents: Array, coordinates: Array) -> Array:
    """(K, T) φ at coordinates (K, m)."""
    values: Array = _factors(exponents, coordinates)[0].prod(axis=0)
    return values


def _basis(exponents: Array, coordinates: Array) -> tuple[Array, Array]:
    """φ (T,) at u (m,), and its slopes (m, T)."""
    values, slopes = (each[:, 0] for each in _factors(exponents, coordinates[None]))
    by = [values[:i].prod(axis=0) * slopes[i] * values[i + 1 :].prod(axis=0) for i in range(len(coordinates))]
    return values.prod(axis=0), np.array(by)


def _factors(exponents: Array, coordinates: Array) -> tuple[Array, Array]:
    """(m, K, T) the polynomial of each coordinate in each term, and its slope."""
    highest = int(exponents.max(initial=0))
    value, slope = np.ones((highest + 1, *coordinates.shape)), np.zeros((highest + 1, *coordinates.shape))
    for order in range(1, highest + 1):
        if order == 1:
            value[1], slope[1] = coordinates, 1.0
        else:  # Tₙ = 2 u Tₙ₋₁ − Tₙ₋₂
            value[order] = 2.0 * coordinates * value[order - 1] - value[order - 2]
            slope[order] = 2.0 * (value[order - 1] + coordinates * slope[order - 1]) - slope[order - 2]
    orders, count = exponents.astype(np.intp), coordinates.shape[1]
    values = np.stack([value[orders[:, i], :, i].T for i in range(count)])
    return values, np.stack([slope[orders[:, i], :, i].T for i in range(count)])
