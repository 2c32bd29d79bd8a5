"""A record of named numbers that Python and C both read and write: a C struct, whose fields come from C (fields.h)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Field = tuple[str, str, int]  # name, type as NumPy names it, and how many; 0: one, which is no array
Numbers = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.uint8] | Sequence[float] | float
Values = dict[str, NDArray[Any]]  # values of all fields, by name


class Record:
    """All zeros at first. `record["gain"]` is a view."""

    def __init__(self, fields: Sequence[Field]) -> None:
        dtype = np.dtype([(name, kind, (count,)) if count else (name, kind) for name, kind, count in fields])
        self._values = np.zeros((), dtype)
        # NumPy takes a microsecond to find a field, and a frame may write twenty.
        self._views: Values = {name: self._values[name] for name in dtype.names or ()}

    @property
    def buffer(self) -> memoryview:
        """What C takes."""
        return self._values.reshape(1).view(np.uint8).data

    @property
    def flat(self) -> Array:
        """All numbers one after the other, where all are doubles."""
        return self._values.reshape(1).view(np.float64)

    def __getitem__(self, name: str) -> Array:
        return self._views[name]

    def number(self, name: str) -> float:
        return float(self._values[name])

    def integer(self, name: str) -> int:
        return int(self._values[name])

    def put(self, name: str, value: Numbers) -> None:
        """Write `value` to the start of a field. ValueError where the field is too short, or there is none."""
        if name not in self._views:
            raise ValueError(f"no field of name {name}")
        part = self._views[name]
        if part.ndim == 0:
            part[...] = value
            return
        flat = value.ravel() if isinstance(value, np.ndarray) else np.ravel(value)
        if len(flat) > len(part):
            raise ValueError(f"{name}: {len(flat)} values, room for {len(part)}")
        part[: len(flat)] = flat

    def fill(self, values: Mapping[str, Numbers]) -> None:
        """Write all of these."""
        for name, value in values.items():
            self.put(name, value)

    def copy(self) -> Values:
        """Each field, as it is now."""
        return {name: self._values[name].copy() for name in self._values.dtype.names or ()}

    def recall(self, values: Values) -> None:
        """Continue from a `copy` of another record of these fields. ValueError, and nothing changes, if it is none."""
        names = self._values.dtype.names or ()
        if set(values) != set(names):
            other = ", ".join(sorted(set(values) ^ set(names))[:3])
            raise ValueError(f"a memory with other fields than this version has ({other} …)")
        for name in names:
            if values[name].shape != self._values[name].shape or values[name].dtype != self._values[name].dtype:
                raise ValueError(f"{name} has the shape {values[name].shape}, not {self._values[name].shape}")
        for name in names:
            self._values[name] = values[name]
