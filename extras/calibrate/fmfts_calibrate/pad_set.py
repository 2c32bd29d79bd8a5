"""Reads a few labelled presses of a pad with one magnet, each with its displacement of the magnet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmfts.baseline import Mounting
from fmfts.contact.contract import OUTPUT_ORDER
from fmfts.pad import Array, Pad
from fmfts_calibrate.array_set import changes_of, of_this_baseline
from fmfts_calibrate.field_table import DataError, read
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.press_set import PressSet

PLACES = OUTPUT_ORDER[:2]
PLACE_MM = 0.5  # deviation of a place that a hand pressed beside a ruler
READ_PLACE_MM = 1.0  # deviation of a place by the uncorrected model
# The change of pose (5,) from the change of the field (N, 3), and its covariance (5, 5); None if no pose explains it.
PoseOf = Callable[[Array], tuple[Array, Array] | None]
# The place (2,) in mm by the uncorrected model from a change of pose (5,) with its covariance (5, 5).
PlaceOf = Callable[[Array, Array], Array]


@dataclass(frozen=True, slots=True)
class PoseSet(PressSet):
    """Presses on one mounted pad with one magnet. change (K, 5), covariance (K, 5, 5): of the magnet's pose since rest,
    in mm and components of the axis."""

    change: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class MountedPad:
    """The pad that the presses are of. baseline: its id."""

    pad: Pad
    mounting: Mounting
    baseline: str
    pose_of: PoseOf
    place_of: PlaceOf


def read_pose_set(path: Path, mounted: MountedPad, pad_size_mm: float, place_mm: float, say: Say) -> PoseSet:
    """Read columns force_n, b1x_ut … and x_mm, y_mm; without places, the model's own are used.

    The fields are as recorded, except in a table that `collect` wrote. place_mm: deviation of a place. Raises
    DataError, which names file, row and column.
    """
    table = of_this_baseline(path, read(path, len(mounted.pad.sensors)), mounted.baseline, say)
    are_known = any(cell.strip() for name in PLACES for cell in table.others.get(name, ()))
    found = changes_of(path, table, mounted.mounting, pad_size_mm, place_mm if are_known else np.inf)
    solved = []
    for change_t, line in zip(found.change_t, found.line, strict=True):
        pose = mounted.pose_of(change_t.reshape(-1, 3))
        if pose is None:
            raise DataError(
                f"{path}: row {line}, columns b1x_ut …: no magnet of this pad explains the field: are the sensors in "
                "the config's order, and is it this pad's baseline?"
            )
        solved.append(pose)
    change, covariance = (np.array(each) for each in zip(*solved, strict=True))
    data = PoseSet(found.press, found.press_deviation, found.line, found.digest, change, covariance)
    if are_known:
        return data
    say(f"{path}: no columns x_mm, y_mm: the places are those that the uncorrected model reads")
    places_mm = [mounted.place_of(*each) for each in zip(change, covariance, strict=True)]
    read_mm = np.full((len(places_mm), 2), max(place_mm, READ_PLACE_MM))
    return replace(
        data,
        press=np.column_stack([places_mm, data.press[:, 2:]]),
        press_deviation=np.column_stack([read_mm, data.press_deviation[:, 2]]),
    )
