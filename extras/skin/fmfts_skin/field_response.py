"""How a contact changes the field of a pad whose magnets are unknown: a table from contact to field, without poses.

The contact is a place, or none, and a load: a depth, a normal force, or shear. Cubic B-splines over each axis:

    change(q) = Σ B_i(q₁) B_j(q₂) B_k(q₃) c_ijk

Beyond the ends of an axis the change goes on along its tangent. The table belongs to a structure. What differs between
two pads of it, or between two days of one, is in `Instance`. Fields are in µT, as in the files that tables come from.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, cholesky, product
from fmfts.arithmetic.spline import cover
from fmfts.common.reading import damage_told

Array = NDArray[np.float64]
PLACE = ("x_mm", "y_mm")
LOADS = ("depth_mm", "force_n", "shear_n")
FORMAT = "fmfts field response 1"
# A pad tries every contact of a grid, finer than the cells, when it starts.
LARGEST_BYTES, MOST_CELLS, MOST_SENSORS, MOST_LEVELS = 16_000_000, 32, 64, 64


class FieldResponseError(ValueError):
    """The file holds no field response."""


class Axis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One coordinate of a contact. Knots stand at first, first + spacing …, cells + 1 of them."""

    name: str
    first: float
    spacing: float
    cells: int

    @property
    def last(self) -> float:
        return self.first + self.spacing * self.cells

    def stencil(self, at: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """For coordinates (K,): the first of the four splines that cover each, their values (K, 4) and slopes."""
        cell, values, slopes = cover(at, self.first, self.spacing, self.cells)
        beyond = at - np.clip(at, self.first, self.last)
        return cell, values + beyond[:, None] * slopes, slopes


@cache
def _corners(axes: int) -> NDArray[np.intp]:
    """(4^axes, axes): which spline of each axis."""
    return np.array(list(itertools.product(range(4), repeat=axes)))


class Felt(NamedTuple):
    """The effect of contacts (K, D) on P values of field: change (K, P), and slope (K, P, D)."""

    change: Array
    slope: Array


@dataclass(frozen=True, slots=True)
class Instance:
    """One pad, or one day of it: field = (1 + moment) · (rest + (1 + gain) · change).

    rest_ut (P,), or (K, P) where each frame has its own. moment: of all magnets, as temperature changes it. gain: of
    the change, as another contact height or stiffness has it.
    """

    rest_ut: Array
    moment: float = 0.0
    gain: float = 0.0

    def change_ut(self, field_ut: Array) -> Array:
        """(K, P) changes of field as the pad of the table would have them, from fields (K, P)."""
        change: Array = (field_ut / (1.0 + self.moment) - self.rest_ut) / (1.0 + self.gain)
        return change


class _Stored(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file, in msgpack. reference, coefficient, covariance: little-endian doubles."""

    format: str
    axes: list[Axis]
    sensors: int
    rests: bool
    levels: list[float]
    moment_share: float
    load_share: float
    origin: str
    reference: bytes
    coefficient: bytes
    covariance: bytes


@dataclass(frozen=True)
class FieldResponse:
    """axes: at most x_mm, y_mm and one load, in this order; D of them. coefficient (cells + 3 of each axis …, P).

    reference_ut (P,): field of the untouched pad, from which changes count. rests: it was recorded; else the presses
    told it. covariance (L, P, P), µT²: of one frame about the table, at loads `levels`:
    repeatability, noise among it. moment_share, load_share: deviations, as shares, of the moment from frame to frame,
    and of the load from pad to pad. origin: what it was made from, for people.
    """

    axes: tuple[Axis, ...]
    reference_ut: Array
    rests: bool
    coefficient: Array
    levels: tuple[float, ...]
    covariance: Array
    moment_share: float
    load_share: float
    origin: str

    @property
    def load(self) -> int:
        """The axis of the load: the last."""
        return len(self.axes) - 1

    def only(self, values: NDArray[np.intp]) -> FieldResponse:
        """The table of some of its values of field: of the sensors that there are."""
        return replace(
            self,
            reference_ut=self.reference_ut[values],
            coefficient=np.ascontiguousarray(self.coefficient[..., values]),
            covariance=np.ascontiguousarray(self.covariance[:, values[:, None], values]),
        )

    def felt(self, contact: Array) -> Felt:
        """The change of the field by contacts (K, D)."""
        stencils = [axis.stencil(contact[:, i]) for i, axis in enumerate(self.axes)]
        corners = _corners(len(self.axes))
        weight = np.ones((len(contact), 1 + len(self.axes), len(corners)))
        row = np.zeros((len(contact), len(corners)), dtype=np.intp)
        for i, (cell, values, slopes) in enumerate(stencils):
            row = row * self.coefficient.shape[i] + cell[:, None] + corners[:, i]
            for kind in range(weight.shape[1]):
                weight[:, kind] *= (slopes if kind == i + 1 else values)[:, corners[:, i]]
        table: Array = product(weight, self.coefficient.reshape(-1, len(self.reference_ut))[row])
        return Felt(table[:, 0], np.moveaxis(table[:, 1:], 1, 2))

    def of_level(self, load: Array) -> tuple[NDArray[np.intp], Array]:
        """Between which two `levels` loads (K,) are: the lower one, and the share of the upper one. The ends go on."""
        if len(self.levels) == 1:
            return np.zeros(len(load), dtype=np.intp), np.zeros(len(load))
        levels = np.array(self.levels)
        inside = np.clip(load, levels[0], levels[-1])
        lower = np.clip(np.searchsorted(levels, inside, side="right") - 1, 0, len(levels) - 2)
        return lower, (inside - levels[lower]) / (levels[lower + 1] - levels[lower])

    def encoded(self) -> bytes:
        """The content of a file that `of` reads."""
        stored = _Stored(
            FORMAT,
            list(self.axes),
            len(self.reference_ut) // 3,
            self.rests,
            list(self.levels),
            self.moment_share,
            self.load_share,
            self.origin,
            *(
                np.ascontiguousarray(one, "<f8").tobytes()
                for one in (self.reference_ut, self.coefficient, self.covariance)
            ),
        )
        return msgspec.msgpack.encode(stored)

    @classmethod
    def of(cls, content: bytes, whose: str) -> FieldResponse:
        """The response in a file's content. FieldResponseError if there is none. whose: the file's name, for the
        error.
        """
        with damage_told(FieldResponseError, f"{whose}: is no field response"):
            stored = msgspec.msgpack.decode(content, type=_Stored)
            if stored.format != FORMAT:
                raise ValueError(f"its format is {stored.format!r}, not {FORMAT!r}")
            axes, values, levels = tuple(stored.axes), 3 * stored.sensors, tuple(stored.levels)
            names = tuple(axis.name for axis in axes)
            if names[-1:] not in {(load,) for load in LOADS} or names[:-1] not in ((), PLACE):
                raise ValueError(f"its axes are {', '.join(names) or 'none'}: a place or none, and one load")
            if not 0 < stored.sensors <= MOST_SENSORS or len(levels) > MOST_LEVELS:
                raise ValueError(f"its table is of {stored.sensors} sensors at {len(levels)} levels of load")
            if not all(
                1 <= axis.cells <= MOST_CELLS and 1e-6 < axis.spacing < 1e6 and abs(axis.first) < 1e6 for axis in axes
            ):
                raise ValueError("its knots are impossible")
            if not levels or any(one >= other for one, other in itertools.pairwise(levels)):
                raise ValueError("its levels of load do not rise")
            shape = (*(axis.cells + 3 for axis in axes), values)
            response = cls(
                axes,
                np.frombuffer(stored.reference, "<f8").reshape(values),
                stored.rests,
                np.frombuffer(stored.coefficient, "<f8").reshape(shape),
                levels,
                np.frombuffer(stored.covariance, "<f8").reshape(len(levels), values, values),
                stored.moment_share,
                stored.load_share,
                stored.origin,
            )
            shares = np.array([stored.moment_share, stored.load_share])
            tables = (response.reference_ut, response.coefficient, response.covariance, shares, np.array(levels))
            if not all(np.isfinite(table).all() for table in tables) or shares.min() < 0.0:
                raise ValueError("its tables contain NaN, infinity, or a negative deviation")
            try:
                cholesky(response.covariance)
            except SingularError as error:
                raise ValueError("its covariance is none") from error
            return response
