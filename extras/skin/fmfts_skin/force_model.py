"""From the change of a pad's field, or of its magnet's pose, to a force in three directions: polynomials, from a file.

    force(x) = Σ w_p · Π x_i^e_pi        x: the change from rest over the scale of the rest; no change is no force

Each set of values that are known together has a polynomial of its own: a value that is clipped or missing is left out
alone. A model of both routes has polynomials of either: a force is their mean, weighed by their variances. A force's
variance has two parts: how far presses that the fit was not told were missed, more where the polynomial is extended
beyond its presses; and what another day does to the force. Both are the same in the next frame, so no average over
frames makes them smaller.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product
from fmfts.common.reading import damage_told

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Route = Literal["field", "pose", "both"]
FORMAT = "fmfts force model 1"
# A value of a sensor, counted from 1, and its axis; or a component of a pose.
VALUE_NAME = re.compile(r"b([1-9][0-9]?)([xyz])|[abcmn]")
# Whether a route has values of sensors (True) and components of a pose (False).
VALUES_OF = {"field": {True}, "pose": {False}, "both": {True, False}}
FORCE = ("force_x_n", "force_y_n", "force_z_n")
DIRECTIONS = 3
MOST_VALUES, MOST_POWER, MOST_MAPS, LARGEST_BYTES = 64, 3, 256, 16_000_000


class ForceModelError(ValueError):
    """The file holds no force model."""


class FoundForces(NamedTuple):
    """force (K, 3) and its variance (K, 3). leverage (K,): how far a row lies from the presses of the fit, 1 for the
    outermost of them. All are NaN in rows of which too few values are known."""

    force: Array
    variance: Array
    leverage: Array


@dataclass(frozen=True, slots=True)
class ForceMap:
    """The polynomial of one set of values.

    known (V,): the values that it takes. power: its largest exponent. scale (P,): of each monomial over the presses.
    weight (P, 3). spread (P, P): a row's leverage is mᵀ·spread·m of its monomials over their scales. floor_n2,
    share (3,): left-out presses were missed by the variance floor_n2 + share · force².
    """

    known: Mask
    power: int
    scale: Array
    weight: Array
    spread: Array
    floor_n2: Array
    share: Array

    def find(self, values: Array) -> FoundForces:
        """The forces of values (K, V); unknown values are not read."""
        basis = monomials(values, self.known, self.power) / self.scale
        force = product(basis, self.weight)
        leverage = (product(basis, self.spread) * basis).sum(axis=1)
        variance = self.floor_n2 + (force * force).sum(axis=1)[:, None] * self.share
        return FoundForces(force, variance * np.maximum(leverage, 1.0)[:, None], leverage)

    def slope(self, values: Array) -> Array:
        """(V, 3): how the force changes with each of the values (V,)."""
        slopes = np.zeros((len(values), len(self.scale)))
        for number, term in enumerate(exponents(self.known, self.power)):
            for at, value in enumerate(term):
                slopes[value, number] += np.prod(values[list(term[:at] + term[at + 1 :])])
        by_value: Array = product(slopes / self.scale, self.weight)
        return by_value


def mean_of(answers: Sequence[FoundForces]) -> FoundForces:
    """The mean of answers by their variances, with the larger leverage.

    Its variance is right whatever the errors have in common: covariance intersection (S. Julier, J. Uhlmann, Proc.
    American Control Conference 1997, 2369) with equal weights.
    """
    if len(answers) == 1:
        return answers[0]
    weights = [1.0 / (len(answers) * one.variance) for one in answers]
    variance = 1.0 / sum(weights[1:], weights[0])
    force = sum((weight * one.force for weight, one in zip(weights, answers, strict=True)), np.zeros(variance.shape))
    return FoundForces(force * variance, variance, np.max([one.leverage for one in answers], axis=0))


def exponents(known: Mask, power: int) -> list[tuple[int, ...]]:
    """For each monomial up to `power` the values whose product it is."""
    values = np.flatnonzero(known).tolist()
    return [one for degree in range(1, power + 1) for one in combinations_with_replacement(values, degree)]


def monomials(values: Array, known: Mask, power: int) -> Array:
    """(K, P) monomials of the known ones of values (K, V)."""
    return np.stack([np.prod(values[:, list(term)], axis=1) for term in exponents(known, power)], axis=1)


class Coverage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The coverage of deviations by left-out rows, x, y and z together. left_out: the kind of fold."""

    left_out: Literal["sessions", "eighths of the time"]
    rows: int
    rms_n: tuple[float, float, float]
    within_2: float
    beyond_5: float


class _StoredMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """known: which values. tables: scale, weight, spread, floor_n2 and share, as little-endian doubles."""

    known: list[bool]
    power: int
    tables: bytes


class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """names (V,): of the values, in order. sessions: how many the model was trained on. day_share: deviation of another
    day's forces, as a share. widened (3,): factor of the deviations, learnt from left-out sessions; 1: only the stated
    prior. largest_n: of the presses. pressed_z: 1 or -1, the sign of force_z_n under a press. origin: what it was made
    from, for people.
    """

    route: Route
    names: tuple[str, ...]
    sessions: int
    day_share: float
    widened: tuple[float, float, float]
    largest_n: float
    pressed_z: float
    coverage: Coverage
    origin: str


class _Stored(_Facts, frozen=True):
    """The file, in msgpack."""

    maps: tuple[_StoredMap, ...]
    format: str


class ForceModel(_Facts, frozen=True):
    """The content of a model's file."""

    maps: tuple[ForceMap, ...]

    def maps_of(self, known: Mask) -> list[ForceMap]:
        """Of each route the polynomial that uses most of the `known` values (V,); without one if all need more."""
        poses = np.array([len(name) == 1 for name in self.names])
        usable = [one for one in self.maps if not (one.known & ~known).any()]
        by_route = [[one for one in usable if not (one.known & other).any()] for other in (poses, ~poses)]
        return [max(own, key=lambda one: int(one.known.sum())) for own in by_route if own]

    def slope(self, values: Array) -> Array:
        """(V, 3): how the force changes with each of the values (V,), as far as these are known."""
        known = np.isfinite(values)
        filled, maps = np.where(known, values, 0.0), self.maps_of(known)
        weight = np.array([1.0 / one.find(filled[None]).variance[0] for one in maps])
        slopes = np.array([one.slope(filled) for one in maps])
        return np.asarray((weight[:, None] * slopes).sum(axis=0) / weight.sum(axis=0))

    def find(self, values: Array) -> FoundForces:
        """Forces of changes over the scale of the rest (K, V); NaN where a value is not known."""
        rows = len(values)
        found = FoundForces(
            np.full((rows, DIRECTIONS), np.nan),
            np.full((rows, DIRECTIONS), np.nan),
            np.full(rows, np.nan),
        )
        known = np.isfinite(values)
        for pattern in np.unique(known, axis=0):
            members = (known == pattern).all(axis=1)
            maps = self.maps_of(pattern)
            if maps:
                filled = np.where(pattern, values[members], 0.0)
                one = mean_of([polynomial.find(filled) for polynomial in maps])
                day = self.day_share * self.day_share * (one.force * one.force).sum(axis=1)
                widened = np.array(self.widened)
                found.force[members] = one.force
                found.variance[members] = widened * widened * (one.variance + day[:, None])
                found.leverage[members] = one.leverage
        return found

    def encoded(self) -> bytes:
        """The content of a file that `of` reads."""
        maps = tuple(
            _StoredMap(
                one.known.tolist(),
                one.power,
                b"".join(
                    np.ascontiguousarray(table, "<f8").tobytes()
                    for table in (one.scale, one.weight, one.spread, one.floor_n2, one.share)
                ),
            )
            for one in self.maps
        )
        return msgspec.msgpack.encode({"format": FORMAT} | msgspec.structs.asdict(self) | {"maps": maps})

    @classmethod
    def of(cls, content: bytes, whose: str) -> ForceModel:
        """The model in a file's content. ForceModelError if there is none. whose: the file's name, for the error."""
        with damage_told(ForceModelError, f"{whose}: is no force model"):
            stored = msgspec.msgpack.decode(content, type=_Stored)
            if stored.format != FORMAT:
                raise ValueError(f"its format is {stored.format!r}, not {FORMAT!r}")
            if not (0 < len(stored.names) <= MOST_VALUES and 0 < len(stored.maps) <= MOST_MAPS):
                raise ValueError(f"it has {len(stored.names)} values and {len(stored.maps)} polynomials")
            numbers = (stored.day_share, *stored.widened, stored.largest_n)
            if not (np.isfinite(numbers).all() and min(numbers) >= 0.0 and stored.largest_n > 0.0):
                raise ValueError("a deviation or its largest force is impossible")
            if stored.pressed_z not in (1.0, -1.0) or not all(VALUE_NAME.fullmatch(name) for name in stored.names):
                raise ValueError("the sign of a press, or the name of a value, is impossible")
            if {len(name) > 1 for name in stored.names} != VALUES_OF[stored.route]:
                raise ValueError(f"its values are not those of the route {stored.route!r}")
            maps = tuple(_map_of(one, len(stored.names)) for one in stored.maps)
            return cls(**{name: getattr(stored, name) for name in _Facts.__struct_fields__}, maps=maps)


def _map_of(stored: _StoredMap, values: int) -> ForceMap:
    known = np.array(stored.known, dtype=np.bool_)
    if len(known) != values or not 1 <= stored.power <= MOST_POWER:
        raise ValueError("a polynomial is of other values than the model")
    count = len(exponents(known, stored.power))
    numbers = np.frombuffer(stored.tables, "<f8")
    sizes = (count, DIRECTIONS * count, count * count, DIRECTIONS, DIRECTIONS)
    ends = [sum(sizes[: part + 1]) for part in range(len(sizes))]
    if len(numbers) != ends[-1] or not np.isfinite(numbers).all():
        raise ValueError("a polynomial's table has another size than it states, or numbers that are not finite")
    scale, weight, spread, floor_n2, share = (numbers[end - size : end] for end, size in zip(ends, sizes, strict=True))
    if min(scale.min(), floor_n2.min()) <= 0.0 or share.min() < 0.0:
        raise ValueError("a polynomial has an impossible scale or deviation")
    square = spread.reshape(count, count)
    return ForceMap(known, stored.power, scale, weight.reshape(count, DIRECTIONS), square, floor_n2, share)
