"""Keeps the magnetic film of a chip magnetised: `Film` in chips/chip.py says why and when."""

from __future__ import annotations

import math
import time
from enum import IntEnum

from fmfts.arithmetic.elementary import power
from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Axes, Chip
from fmfts.sensor.i2c.sensor import Sensor, now_us


class Exposure(IntEnum):
    """Exposure of a film to fields since its last pulse."""

    NOTHING = 0
    DOUBTFUL = 1
    UPSET = 2


def undisturbed(chip: Chip, gain_code: int, sensor: Sensor, axes: Axes) -> Axes:
    """`axes`; all of them marked as saturated where the film may be upset. When the field has gone, a pulse mends it.

    The sample that shows that the field has gone was still measured with an upset film.
    """
    film = chip.film
    if film is None:
        return axes
    square = _square_of_gauss(chip, gain_code, axes)
    met = Exposure.UPSET if square > power(film.upset_gauss, 2) else Exposure(square > power(film.doubtful_gauss, 2))
    has_gone = met == Exposure.NOTHING and sensor.exposure != Exposure.NOTHING
    sensor.exposure = max(sensor.exposure, met)
    if sensor.exposure < Exposure.UPSET and not has_gone:
        return axes
    if has_gone:
        magnetise(chip, sensor)
    return chip.saturated_count, chip.saturated_count, chip.saturated_count


def magnetise(chip: Chip, sensor: Sensor) -> None:
    """Only while no measurement is running: the effect of a pulse on one is in no source."""
    assert chip.film is not None
    sensor.wires.write(chip.film.pulse)
    sensor.exposure, sensor.magnetised_us = Exposure.NOTHING, now_us()
    time.sleep(chip.film.pause_s)


def is_due(chip: Chip, sensor: Sensor) -> bool:
    """The last pulse was long ago."""
    return chip.film is not None and now_us() - sensor.magnetised_us > 1e6 * chip.film.every_s


def _square_of_gauss(chip: Chip, gain_code: int, axes: Axes) -> float:
    """The square of the field's norm."""
    if chip.saturated_count in axes:
        return math.inf
    x, y, z = (
        count * float(step_t) / TESLA_PER_GAUSS for count, step_t in zip(axes, chip.step_t[gain_code], strict=True)
    )
    return x * x + y * y + z * z
