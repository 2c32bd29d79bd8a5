"""Reads a plan, GRID.toml: the places to press, and the forces. The paper's three plans ship as presets."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from fmfts.common.reading import damage_told, read_regular
from fmfts.common.toml import LARGEST_BYTES, NotToml, parse
from fmfts.config.section import PositiveFloat, Section

PRESETS = Path(__file__).with_name("presets")
MOST_PRESSES = 100_000
Count = Annotated[int, Meta(ge=1, le=1000)]
Pair = tuple[float, float]


class PlanError(Exception):
    """The plan cannot be used; the text names the file, the key, and what is wrong."""


class Lattice(Section, frozen=True):
    """Places in rows and columns; each is pressed with every force."""

    first_mm: Pair
    spacing_mm: PositiveFloat
    count: tuple[Count, Count]
    forces_n: tuple[PositiveFloat, ...]


class RandomPresses(Section, frozen=True):
    """Uniformly distributed random places and forces; the same seed gives the same ones."""

    presses: Count
    half_width_mm: PositiveFloat
    force_n: tuple[PositiveFloat, PositiveFloat]
    seed: int = 1


class _File(Section, frozen=True):
    lattice: Lattice | None = None
    random: RandomPresses | None = None


@dataclass(frozen=True, slots=True)
class Press:
    """A press of the plan: its number, its place in pad axes, and its force."""

    number: int
    x_m: float
    y_m: float
    force_n: float

    @property
    def place_m(self) -> tuple[float, float]:
        return self.x_m, self.y_m


@dataclass(frozen=True)
class Plan:
    """Presses in their order: place by place, the lightest force of a place first."""

    name: str
    presses: tuple[Press, ...]

    @cached_property
    def fingerprint(self) -> str:
        """Twelve hex digits of all places and forces in order, by which a table knows whether it is of this plan."""
        text = ",".join(f"{press.x_m:.6f} {press.y_m:.6f} {press.force_n:.6f}" for press in self.presses)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    @property
    def largest_force_n(self) -> float:
        return max(press.force_n for press in self.presses)


def read_plan(name: str) -> Plan:
    """The plan in the file `name`, or the preset of that name. Raises PlanError where there is none, or it is wrong."""
    path = Path(name)
    if not path.exists() and (PRESETS / f"{name}.toml").exists():
        path = PRESETS / f"{name}.toml"
    try:
        content = read_regular(path, LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: the name holds a zero byte
        presets = ", ".join(sorted(preset.stem for preset in PRESETS.glob("*.toml")))
        why = error.strerror if isinstance(error, OSError) else error
        raise PlanError(f"{name}: {why}; the presets are {presets}") from error
    with damage_told(PlanError, f"{path}: is not a plan"):
        return _plan(path, content)


def _plan(path: Path, content: bytes) -> Plan:
    try:
        file = msgspec.convert(parse(content.decode("utf-8")), _File)
    except (NotToml, UnicodeDecodeError) as error:
        raise PlanError(f"{path}: is not TOML: {error}") from error
    except msgspec.ValidationError as error:
        raise PlanError(f"{path}: {error}") from error
    if (file.lattice is None) == (file.random is None):
        raise PlanError(f"{path}: one table is needed, [lattice] or [random]")
    if file.random and not file.random.force_n[0] < file.random.force_n[1]:
        raise PlanError(f"{path}: random.force_n: the lighter force comes first")
    if file.lattice and math.prod(file.lattice.count) * len(file.lattice.forces_n) > MOST_PRESSES:
        raise PlanError(f"{path}: has more than {MOST_PRESSES} presses, which take weeks: make several plans")
    presses = _lattice(file.lattice) if file.lattice else _random(file.random) if file.random else []
    if not presses:
        raise PlanError(f"{path}: lattice.forces_n names no force")
    return Plan(path.stem, tuple(Press(number, x, y, force) for number, (x, y, force) in enumerate(presses, start=1)))


def _lattice(lattice: Lattice) -> list[tuple[float, float, float]]:
    """(x_m, y_m, force_n) of all presses. Every second row runs backwards, to avoid long ways back."""
    columns, rows = lattice.count
    places = [
        (column if row % 2 == 0 else columns - 1 - column, row) for row in range(rows) for column in range(columns)
    ]
    (x, y), spacing = lattice.first_mm, lattice.spacing_mm
    return [
        ((x + column * spacing) * 1e-3, (y + row * spacing) * 1e-3, force)
        for column, row in places
        for force in sorted(lattice.forces_n)
    ]


def _random(plan: RandomPresses) -> list[tuple[float, float, float]]:
    random = np.random.default_rng(plan.seed)
    places = random.uniform(-plan.half_width_mm, plan.half_width_mm, (plan.presses, 2)) * 1e-3
    forces = random.uniform(*plan.force_n, plan.presses)
    return [(float(x), float(y), float(force)) for (x, y), force in zip(places, forces, strict=True)]
