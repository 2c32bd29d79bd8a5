"""Defines the base class of all tables of the configuration file, and its number types."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Key = str | int
Problem = tuple[tuple[Key, ...], str]  # the path of keys to a value, and what is wrong with it
PositiveFloat = Annotated[float, Meta(gt=0)]
NonNegativeFloat = Annotated[float, Meta(ge=0)]
Fraction = Annotated[float, Meta(ge=0, le=0.5)]


class Section(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file; an unknown key in it is an error."""
