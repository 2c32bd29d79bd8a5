"""Labelled presses of one mounted pad, to compare by field (array_set.py) or pose (pad_set.py)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class PressSet:
    """K presses. Every array has a row for each.

    press (K, 5): x and y in mm, force, and shear along x and y in N. press_deviation (K, 3): of place and force.
    line (K,): in the file. digest: SHA-256 of the file.
    """

    press: Array
    press_deviation: Array
    line: tuple[int, ...]
    digest: str

    @property
    def has_shear(self) -> bool:
        return bool(self.press[:, 3:].any())

    def only(self, rows: Rows) -> Self:
        """Some of the presses."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        changed: dict[str, Any] = {name: one[rows] for name, one in values.items() if isinstance(one, np.ndarray)}
        return replace(self, line=tuple(self.line[row] for row in rows.tolist()), **changed)
