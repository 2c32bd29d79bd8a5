"""A skin with four magnets over the five sensors of an AnySkin board: fields of presses, for tests. Dipoles in µT."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts_calibrate.field_table import write
from fmfts_skin.calibrate.field_set import FieldSet

Array = NDArray[np.float64]
SENSORS_MM = np.array([[0.0, 0.0, 0.0], [7.0, 0.0, 0.0], [-7.0, 0.0, 0.0], [0.0, 7.0, 0.0], [0.0, -7.0, 0.0]])
MAGNETS_MM = np.array([[6.0, 6.0, 9.0], [-6.0, 6.0, 9.0], [6.0, -6.0, 9.0], [-6.0, -6.0, 9.0]])
MOMENTS_AM2 = np.array([0.05, -0.05, -0.05, 0.05])
SPREAD_MM = 6.0
REACH_MM = 10.0
DEEPEST_MM = 3.0


def skin_field(press: Array) -> Array:
    """(K, 15) µT of presses x, y, depth (K, 3) in mm."""
    apart = MAGNETS_MM[:, :2] - press[:, None, :2]
    share = np.exp(-(apart**2).sum(axis=2) / (2.0 * SPREAD_MM**2))[:, :, None] * press[:, None, 2:]
    moved = MAGNETS_MM + np.concatenate([0.15 * share * apart / SPREAD_MM, -0.4 * share], axis=2)
    way = (SENSORS_MM[None, :, None] - moved[:, None]) * 1e-3
    far = np.sqrt((way**2).sum(axis=3))[..., None]
    moment = MOMENTS_AM2[:, None] * np.array([0.0, 0.0, 1.0])
    along = (way * moment).sum(axis=3)[..., None]
    field = 1e-7 * (3.0 * way * along / far**5 - moment / far**3)
    summed: Array = field.sum(axis=2).reshape(len(press), -1) * 1e6
    return summed


def streamed_field(press: Array) -> Array:
    """The same field of weaker magnets, within ±52 G, which the boards' stream can carry."""
    weaker: Array = 0.4 * skin_field(press)
    return weaker


def presses(count: int, seed: int) -> Array:
    random = np.random.default_rng(seed)
    place = random.uniform(-REACH_MM, REACH_MM, (count, 2))
    return np.column_stack([place, random.uniform(0.2, DEEPEST_MM, count)])


def skin_set(press: Array, field_ut: Array, axes: tuple[str, ...] = ("x_mm", "y_mm", "depth_mm")) -> FieldSet:
    count = len(press)
    return FieldSet(
        axes, press, field_ut, np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.intp), ("skin",), "none"
    )


def write_skin(path: Path, data: FieldSet) -> Path:
    """Write the skin as a CSV file."""
    columns = {name: [repr(float(one)) for one in data.contact[:, i]] for i, name in enumerate(data.axes)}
    columns["rest"] = [str(int(one)) for one in data.rest]
    columns["recording"] = [data.recordings[one] for one in data.recording]
    for value in range(data.field_ut.shape[1]):
        columns[f"b{value // 3 + 1}{'xyz'[value % 3]}_ut"] = [repr(float(one)) for one in data.field_ut[:, value]]
    with path.open("w") as out:
        write(columns, out)
    return path
