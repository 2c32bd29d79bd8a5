"""Compares the fields of a table with that of the pad's magnet at rest: a wrong unit shows as a large factor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmfts.common.names import field_columns
from fmfts.pad import Array, Pad
from fmfts_calibrate.field_table import DataError, FieldTable
from fmfts_simulation.cylinder import cylinder_field

UNITS = {1e-2: "gauss", 1e1: "milligauss", 1e-3: "millitesla", 1e-6: "tesla", 1e3: "nanotesla"}


def drawn_field(pad: Pad) -> Array:
    """(N, 3) field of the unloaded pad according to its drawing, in the sensors' axes."""
    return pad.sensors.to_sensor(cylinder_field(pad.sensors.position_m, pad.rest_position_m, pad.rest_axis, pad.magnet))


def strengths(table: FieldTable, pad: Pad) -> Array:
    """(K,) size of each row's field, in the values that are known, as a multiple of that of the drawing."""
    known = np.isfinite(table.field_t)
    drawn = np.linalg.norm(np.where(known, drawn_field(pad), 0.0), axis=(1, 2))
    with np.errstate(invalid="ignore"):
        sizes: Array = np.linalg.norm(np.where(known, table.field_t, 0.0), axis=(1, 2)) / drawn
    return sizes


def other_unit(ratio: float) -> str:
    """The unit in which fields of this multiple probably are; "" where none fits."""
    unit = min(UNITS, key=lambda factor: abs(np.log(ratio / factor)))
    return UNITS[unit] if 0.5 < ratio / unit < 2.0 else ""


def require_unit(path: Path, table: FieldTable, pad: Pad) -> None:
    """DataError where most rows' fields are as large as in another unit than µT."""
    known = strengths(table, pad)
    known = known[np.isfinite(known) & (known > 0.0)]
    if len(known) and (unit := other_unit(ratio := float(np.median(known)))):
        raise DataError(f"{path}: {stronger(pad, ratio)} in most rows; {question(unit)}")


def stronger(pad: Pad, ratio: float) -> str:
    names = field_columns(len(pad.sensors))
    return f"columns {names[0]} … {names[-1]}: the field is {ratio:.3g} times that of this pad's magnet at rest,"


def question(unit: str) -> str:
    """unit: as `other_unit` gives it."""
    asked = f"were they in {unit}?" if unit else "is it the magnet of the config?"
    return f"these columns are in µT (1 G = 100 µT): {asked}"
