"""The inputs to train and test the paper's networks: its 675 presses, and others that were solved one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fmfts_simulation
from fmfts.pad import Array, Pad
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import rest_field
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.tracked import FrameSolver, Tracked
from fmfts_lab.calibration.simulated import magnet_fields, rest_field_of
from fmfts_lab.calibration.standard_set import standard_set

# The solved presses with which the shipped model is tested.
SOLVED_TEST = Path(fmfts_simulation.__path__[0]) / "test_normal.csv"
PAPER_REMANENCE_T = 1.23  # Eq. 5: the paper scales its moment vector so that a magnet of 1.23 T has length one


@dataclass(frozen=True, slots=True)
class Readings:
    """Presses (K, 3: mm, N) of one pad, its fields (K, N, 3), and the poses solved with two sets of unknowns.

    remanence_t: estimated from the field of the unloaded pad.
    """

    press: Array
    field_t: Array
    remanence_t: float
    paper: Tracked
    daemon: Tracked

    @classmethod
    def of(cls, pad: Pad, press: Array, field_t: Array, rest_field_t: Array) -> Readings:
        paper = FrameSolver(pad, rest_field_t, "constant", NOISE_T)
        daemon = FrameSolver(pad, rest_field_t, "drifting", NOISE_T)
        return cls(press, field_t, daemon.remanence_t, paper.solved(field_t), daemon.solved(field_t))

    @classmethod
    def calibration(cls) -> Readings:
        """The paper's grid and forces at 1.23 T."""
        known = standard_set()
        return cls.of(known.pad, known.press, known.field_t, rest_field(known))

    @classmethod
    def solved_test(cls, pad: Pad, path: Path | None = None) -> Readings:
        """Presses off the grid, each solved by finite elements, with the magnet of `pad`."""
        path = path or SOLVED_TEST
        _required(path, f"`python -m fmfts_lab.finite_elements.solved_presses test-normal {path}` solves them")
        table = np.genfromtxt(path, delimiter=",", names=True)
        press = np.stack([table[name] for name in ("x_mm", "y_mm", "force_n")], axis=1)
        displacement_m = np.stack([table[name] for name in ("dx_um", "dy_um", "dz_um")], axis=1) * 1e-6
        tilt = np.stack([table["axis_x"], table["axis_y"]], axis=1)
        axis = np.column_stack([tilt, np.sqrt(1.0 - np.sum(tilt**2, axis=1))])
        return cls.of(pad, press, magnet_fields(pad, displacement_m, axis), rest_field_of(pad))


def _field(readings: Readings) -> Array:
    return readings.field_t.reshape(len(readings.press), -1) * 1e4


def _paper_pose(readings: Readings) -> Array:
    pose = readings.paper.pose.copy()
    pose[:, 3:] *= readings.paper.remanence_t[:, None] / PAPER_REMANENCE_T
    return pose


def _unit_pose(readings: Readings) -> Array:
    return readings.paper.pose[:, :5]


# Name → the inputs of a regressor.
INPUTS: dict[str, Callable[[Readings], Array]] = {
    "field": _field,
    "pose": _paper_pose,
    "pose, unit axis": _unit_pose,
}


def _required(path: Path, remedy: str) -> Path:
    if not path.is_file():
        raise DataError(f"there is no {path}: {remedy}")
    return path
