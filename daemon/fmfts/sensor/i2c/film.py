"""Keeps the magnetic film of a chip magnetised: `Film` in chips/chip.py says why and when."""

from __future__ import annotations

import time

from fmfts.sensor.chips.chip import Axes, Chip
from fmfts.sensor.i2c.sensor import Sensor, now_us


def undisturbed(chip: Chip, gain_code: int, sensor: Sensor, axes: Axes) -> Axes:
    """`axes`; all of them marked as saturated from a field that may have upset the film until a pulse has mended it.

    The pulse follows the first reading without such a field. Only one axis may show the field, and all are upset.
    """
    if chip.film is None:
        return axes
    if chip.is_upset_by(gain_code, axes):
        sensor.upset = True
    elif sensor.upset:
        magnetise(chip, sensor)
    else:
        return axes
    return chip.saturated_count, chip.saturated_count, chip.saturated_count


def magnetise(chip: Chip, sensor: Sensor) -> None:
    """The measurement that is running, if any, is spoilt."""
    assert chip.film is not None
    sensor.wires.write(chip.film.pulse)
    sensor.upset, sensor.magnetised_us = False, now_us()
    time.sleep(chip.film.pause_s)


def is_due(chip: Chip, sensor: Sensor) -> bool:
    """The last pulse was long ago."""
    return chip.film is not None and now_us() - sensor.magnetised_us > 1e6 * chip.film.every_s
