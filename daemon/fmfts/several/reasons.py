"""The reasons in the messages of a pad with several magnets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fmfts.bus.messages import Health
from fmfts.several.odd_sensor import FEWEST_VALUES

THREE = "two fingers do not explain the field, a third one would: places and forces are not told"
OTHER_PRESS = (
    "no two fingers explain the field, but poses of the magnets do: more than two fingers press, or something of "
    "another shape; poses are told, places and forces are not"
)
NOT_SEARCHED_PRESS = (
    "poses of the magnets explain the field, and fingers are searched in each tenth frame: more than two press, or "
    "something of another shape; places and forces are not told"
)
MAYBE_TWO = (
    "one finger explains this field badly: two that are too near or too unequal to be told apart may press, "
    "or something wider than a finger"
)
JUMPED = (
    "the field jumped by more than a finger changes it between two samples: a wire that was moved, a blow, or a magnet"
)
UNSETTLED = "nothing explained the field a moment ago: these fingers may be others than those that press"
UNSETTLED_POSES = "nothing explained the field a moment ago: these poses may be others than the true ones"
SEARCH_IS_DUE = "a search for another finger is due, and waits for the searches of other pads"
POSES_UNDETERMINED = "the sensors that are left do not tell where the magnets are"
UNDETERMINED = "the sensors that are left do not tell where the fingers are"


def unexplained(chi2: float) -> str:
    return (
        f"no fingers explain the field (χ² = {chi2:.0f}): steel or a magnet nearby, more than two fingers, a bad chip, "
        "or a press that the pad was not calibrated for"
    )


def unexplained_by_poses(chi2: float) -> str:
    return (
        f"no poses of the magnets explain the field (χ² = {chi2:.0f}): steel or a magnet nearby, a bad chip, or a "
        "magnet that broke or came loose"
    )


def poses_not_searched(chi2: float) -> str:
    return f"no poses explain the field (χ² = {chi2:.0f}); a search for a wrong sensor is due, and waits for other pads"


def not_searched(chi2: float) -> str:
    return f"the fingers of before do not explain the field (χ² = {chi2:.0f}); {SEARCH_IS_DUE}"


def too_few(missing: Mapping[int, str], used: NDArray[np.bool_]) -> str:
    only = f"only {int(used.sum())} values are left, and two fingers need {FEWEST_VALUES}"
    return "; ".join([only, *_missing(missing)])


def too_few_for_poses(missing: Mapping[int, str], used: NDArray[np.bool_], needed: int) -> str:
    only = f"only {int(used.sum())} values are left, and the poses of all magnets need {needed}"
    return "; ".join([only, *_missing(missing)])


def health_of_axes(used: NDArray[np.bool_], missing: Mapping[int, str], left_out: int) -> tuple[Health, str]:
    """Of a frame that fingers explain. missing: sensor (from 0) → why it cannot be used. left_out: a sensor that
    contradicts all others, −1: none."""
    if np.count_nonzero(used) == used.size:
        return "ok", ""
    told = _missing(missing)
    if left_out >= 0:
        told.append(f"sensor {left_out + 1} contradicts all others, and is left out: a bad chip or steel")
    axes = [
        f"{sensor + 1}{'xyz'[axis]}" for sensor, each in enumerate(used.tolist()) for axis in range(3) if not each[axis]
    ]
    return "degraded", "; ".join(told) or f"axes {', '.join(axes)} are saturated or stuck, and are left out"


def _missing(missing: Mapping[int, str]) -> list[str]:
    return [f"sensor {sensor + 1} is {why}" for sensor, why in missing.items()]
