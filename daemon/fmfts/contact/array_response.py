"""How presses change the poses of all magnets of a pad: a table of presses, one finger each.

Cubic B-splines over the place, times powers of the normal force, so that an unloaded pad is exactly at rest; shear adds
a term that is linear in it:

    change(x, y, F, S) = Σ_ij B_i(x) B_j(y) (Σ_t c_ijt F^(t+1) + Σ_a s_ija S_a)

Several fingers at once change the poses by the sum of what each does alone; docs/several.md has how far that holds.
Beyond the largest force of the table the change continues along its tangent. A place beyond the table counts as on its
edge. Units are those of the contact models: mm, N, and components of the axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.common import possible
from fmfts.common.reading import damage_told
from fmfts.contact import _contact

Array = NDArray[np.float64]
CHANGE = 5
PRESSED = 7  # values that the table gives for each component of a pose: see Pressed
FORMAT = "fmfts array response 1"
# The table that ships has 0.28 MB, 17 knots and 4 terms.
LARGEST_BYTES, MOST_KNOTS = 4_000_000, 66
# Limits of several.h: terms, and places of a grid (several/scan.py).
MOST_TERMS, WIDEST_MM = 8, 60.0
# Relative error of a change of pose by the shipped table (lab/results/several.md).
SHIPPED_ERROR, LARGEST_ERROR = 0.005, 0.2


class ResponseError(ValueError):
    """The file holds no response of several magnets."""


class Pressed(NamedTuple):
    """The effect of one finger on P = 5M components of pose: change (P,); slope (P, 3) by x, y and the force; by_shear
    (P, 2); and laplacian (P,), ∂²/∂x² + ∂²/∂y² of the change, which gives the effect of a wider patch.
    """

    change: Array
    slope: Array
    by_shear: Array
    laplacian: Array

    @classmethod
    def of(cls, packed: Array) -> Pressed:
        """From what C writes (…, 7P): press_table.h. For several fingers, with (K, …) in front."""
        poses, front = packed.shape[-1] // PRESSED, packed.shape[:-1]
        slope, by_shear = packed[..., poses : 4 * poses], packed[..., 4 * poses : 6 * poses]
        slope, by_shear = slope.reshape(*front, poses, 3), by_shear.reshape(*front, poses, 2)
        return cls(packed[..., :poses], slope, by_shear, packed[..., 6 * poses :])


class _Stored(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The file, in msgpack. coefficient, shear: little-endian doubles; shape: of the coefficients. error: as in
    ArrayResponse; left out of the table that ships."""

    format: str
    geometry_hash: str
    first_mm: float
    spacing_mm: float
    scale_n: float
    shape: tuple[int, int, int, int]
    coefficient: bytes
    shear: bytes
    error: float = SHIPPED_ERROR


@dataclass(frozen=True)
class ArrayResponse:
    """first_mm, spacing_mm: the knots along x and along y, X of them. scale_n: the table's largest normal force.

    coefficient (X + 2, X + 2, T, P): of F, F² … F^T. shear (X + 2, X + 2, 2, P): per newton along x and y.
    geometry_hash: of the pad that it was made for. error: deviation of a change of pose, relative to it.
    """

    first_mm: float
    spacing_mm: float
    scale_n: float
    coefficient: Array
    shear: Array
    geometry_hash: str
    error: float = SHIPPED_ERROR

    @property
    def last_mm(self) -> float:
        return self.first_mm + self.spacing_mm * float(len(self.coefficient) - 3)

    @cached_property
    def table(self) -> Array:
        """(X + 2, X + 2, T + 2, P): coefficient and shear, as press_table.h has them."""
        return np.ascontiguousarray(np.concatenate([self.coefficient, self.shear], axis=2), dtype=float)

    def pressed(self, x_mm: float, y_mm: float, force_n: float) -> Pressed:
        """The effect of a finger without shear; see Pressed."""
        return Pressed(*(each[0] for each in self.pressed_alone(*np.array([[x_mm], [y_mm], [force_n]], float))))

    def pressed_alone(self, x_mm: Array, y_mm: Array, force_n: Array) -> Pressed:
        """The effect of each of K fingers alone: as `pressed`, K in front."""
        width, _, terms, numbers = self.coefficient.shape
        fingers, packed = np.stack([x_mm, y_mm, force_n], axis=1), np.empty((len(x_mm), PRESSED * numbers))
        _contact.pressed(self.table, width, terms, self.first_mm, self.spacing_mm, self.scale_n, fingers, packed)
        return Pressed.of(packed)

    @classmethod
    def unknown(cls, magnets: int) -> ArrayResponse:
        """For a pad without a table of presses: no press moves any magnet."""
        nothing = np.zeros((5, 5, 1, CHANGE * magnets))
        return cls(0.0, 1.0, 1.0, nothing, np.zeros((5, 5, 2, CHANGE * magnets)), "")

    def only(self, magnets: Sequence[int]) -> ArrayResponse:
        """The same for some of the magnets, in this order. Each moves as if the others were absent."""
        numbers = [CHANGE * magnet + number for magnet in magnets for number in range(CHANGE)]
        return replace(self, coefficient=self.coefficient[..., numbers], shear=self.shear[..., numbers])

    def encoded(self) -> bytes:
        """The content of a file that `of` reads."""
        stored = _Stored(
            FORMAT,
            self.geometry_hash,
            self.first_mm,
            self.spacing_mm,
            self.scale_n,
            self.coefficient.shape,
            np.ascontiguousarray(self.coefficient, "<f8").tobytes(),
            np.ascontiguousarray(self.shear, "<f8").tobytes(),
            self.error,
        )
        return msgspec.msgpack.encode(stored)

    @property
    def magnets(self) -> int:
        return int(self.coefficient.shape[3]) // CHANGE

    @classmethod
    def of(cls, content: bytes, whose: str) -> ArrayResponse:
        """From a file's content. ResponseError if it is no such response. whose: the file's name, for the error."""
        with damage_told(ResponseError, f"{whose}: this is no response of several magnets"):
            stored = msgspec.msgpack.decode(content, type=_Stored)
            if stored.format != FORMAT:
                raise ValueError(f"its format is {stored.format!r}, not {FORMAT!r}")
            width, depth, terms, numbers = stored.shape
            if depth != width or not 5 <= width <= MOST_KNOTS or not 1 <= terms <= MOST_TERMS:
                raise ValueError("its table has an impossible size")
            if numbers < 1 or numbers % CHANGE:
                raise ValueError("its table has an impossible size")
            response = cls(
                stored.first_mm,
                stored.spacing_mm,
                stored.scale_n,
                np.frombuffer(stored.coefficient, "<f8").reshape(stored.shape),
                np.frombuffer(stored.shear, "<f8").reshape(width, width, 2, numbers),
                stored.geometry_hash,
                stored.error,
            )
            if not (np.isfinite(response.coefficient).all() and np.isfinite(response.shear).all()):
                raise ValueError("its table contains NaN or infinity")
            if not (
                possible.SPACING_MM.holds(response.spacing_mm)
                and possible.FORCE_N.holds(response.scale_n)
                and possible.PLACE_MM.holds(response.first_mm)
            ):
                raise ValueError("its knots or its largest force are impossible")
            width_mm = response.last_mm - response.first_mm
            if width_mm > WIDEST_MM:
                raise ValueError(f"its table is {width_mm:g} mm wide: at most {WIDEST_MM:g}")
            if not 0.0 < response.error <= LARGEST_ERROR:
                raise ValueError("its error is impossible")
            return response
