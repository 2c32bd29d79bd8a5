"""Calibration sets: labelled fields of one pad, in SI."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Pad


def standard_pad(remanence_t: float = 1.23) -> Pad:
    """The pad that ships: the defaults of `[pad.geometry]` and `[pad.magnet]`."""
    pad = PadConfig(name="standard", source=SimulatedSource()).pad()
    return replace(pad, magnet=pad.magnet.with_remanence(remanence_t))


@dataclass(frozen=True, slots=True)
class CalibrationSet:
    """Presses (K,) with their labels, and the field (K, n, 3) at the pad's sensors, ambient subtracted, in pad axes."""

    pad: Pad
    x_m: Array
    y_m: Array
    force_n: Array
    field_t: Array


def read_calibration_set(path: Path) -> CalibrationSet:
    """A CSV with x_mm, y_mm, force_n and b1x_ut … b4z_ut of the standard pad, as the README describes it."""
    with path.open() as lines:
        header = lines.readline().strip().split(",")
        table = np.loadtxt(lines, delimiter=",", ndmin=2)
    pad = standard_pad()
    wanted = [f"b{sensor}{axis}_ut" for sensor in range(1, len(pad.sensors) + 1) for axis in "xyz"]
    missing = [name for name in ["x_mm", "y_mm", "force_n", *wanted] if name not in header]
    if missing:
        raise ValueError(f"{path}: no column {', '.join(missing)} in the header")
    column = {name: table[:, position] for position, name in enumerate(header)}
    return CalibrationSet(
        pad=pad,
        x_m=column["x_mm"] * 1e-3,
        y_m=column["y_mm"] * 1e-3,
        force_n=column["force_n"],
        field_t=np.stack([column[name] for name in wanted], axis=1).reshape(-1, len(pad.sensors), 3) * 1e-6,
    )
