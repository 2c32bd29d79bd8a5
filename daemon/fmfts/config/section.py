"""Defines the base class of all tables of the configuration file, and its number types."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Key = str | int
Problem = tuple[tuple[Key, ...], str]  # the path of keys to a value, and what is wrong with it
Fraction = Annotated[float, Meta(ge=0, le=0.5)]
PositiveFloat = Annotated[float, Meta(gt=0, le=1e5)]
NonNegativeFloat = Annotated[float, Meta(ge=0, le=1e5)]
# Standard deviations. Larger ones would say nothing of a fingertip, and are probably in another unit.
DeviationMm = Annotated[float, Meta(ge=0, le=50)]
DeviationDeg = Annotated[float, Meta(ge=0, le=90)]
# A part of a place in mm, of a rotation in degrees, or of a direction. A robot's pads are within 100 m.
Part = Annotated[float, Meta(ge=-1e5, le=1e5)]
Vector = tuple[Part, Part, Part]


class Section(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file; an unknown key in it is an error."""
