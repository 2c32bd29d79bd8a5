"""Says which sensors of a frame cannot be used, and why: silent, saturated on an axis, or stuck on one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.sensor.chips import Chip
from fmfts.sensor.frame import Frame

AXES = "xyz"
SILENT = "silent"


def missing_sensors(frame: Frame, stuck: NDArray[np.bool_] | None = None) -> dict[int, str]:
    """Sensor (from 0) → what is wrong with it, to follow "sensor 1 is ". stuck (N, 3): axes that repeat one value."""
    found: dict[int, str] = {}
    overflow, impossible = frame.overflow, frame.impossible
    if frame.valid.all() and not (overflow.any() or impossible.any() or (stuck is not None and stuck.any())):
        return found
    for sensor in range(len(frame.valid)):
        if not frame.valid[sensor]:
            found[sensor] = SILENT
        elif overflow[sensor].any():
            found[sensor] = saturated(frame.chip, frame.gain_code, overflow[sensor])
        elif impossible[sensor].any():
            found[sensor] = untellable(frame.chip, impossible[sensor])
        elif stuck is not None and stuck[sensor].any():
            found[sensor] = f"stuck on {_named(stuck[sensor])}, which repeats one value (run selftest)"
    return found


def saturated(chip: Chip, gain_code: int, axes: NDArray[np.bool_]) -> str:
    """What is wrong with a sensor whose `axes` (3,) are saturated, and the range to set."""
    return f"saturated on {_named(axes)}{saturated_at(chip, gain_code)}"


def saturated_at(chip: Chip, gain_code: int) -> str:
    """The range at which a sensor saturates, and what to do: the words after the axes."""
    now = chip.ranges_gauss[gain_code] if gain_code < len(chip.ranges_gauss) else 0.0
    larger = [each for each in chip.ranges_gauss if each > now]
    do = f"set range_gauss = {larger[0]:g}" if larger else "no range is larger: is another magnet near?"
    if chip.streamed:
        do = "the board's firmware sets this range: take a weaker magnet, or set a lower gain there"
    return f" at ±{now:g} G ({do})"


def untellable(chip: Chip, axes: NDArray[np.bool_]) -> str:
    """What is wrong with a sensor whose `axes` (3,) have a count that is impossible for `chip`."""
    return f"telling on {_named(axes)}{untellable_by(chip)}"


def untellable_by(chip: Chip) -> str:
    """The words after the axes for an impossible count."""
    return f" what its converter cannot (is it {chip.named}?)"


def _named(axes: NDArray[np.bool_]) -> str:
    return " and ".join(AXES[axis] for axis in np.flatnonzero(axes))
