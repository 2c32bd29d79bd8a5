"""The measurements of the check with one magnet, and its assumptions about the board and the person's hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Pad, Tolerance

Array = NDArray[np.float64]

# Deviations from the drawing. A chip's sensitive spot is not in its middle, so the place has a floor.
LEAST_PLACE_M = 3e-4
LEAST_ROTATION_RAD = np.radians(1.5)
LEAST_GAIN = 0.05
# A hand trembles while the field is averaged, and the Earth's field changes where iron moves.
AMBIENT_T = 5e-7
# A disk of 10 mm at 40 mm differs from a dipole by up to 2 % of the field, besides what is common to all sensors.
FINITE_MAGNET = 0.015


@dataclass(frozen=True, slots=True)
class Readings:
    """change_t (K, N, 3): in step k, the magnet's field in channel c's reading, in the axes of its chip.

    noise_t (N, 3): standard deviation of a change. Channels are the sensors as they arrive, in the order of the frames.
    """

    change_t: Array
    noise_t: Array


@dataclass(frozen=True, slots=True)
class Board:
    """The board as drawn: places (N, 3), and axes (N, 3, 3), whose columns are each chip's axes in pad axes."""

    place_m: Array
    axes: Array
    place_sd_m: float
    rotation_sd_rad: float
    gain_sd: float

    @classmethod
    def of(cls, pad: Pad, tolerance: Tolerance) -> Board:
        return cls(
            pad.sensors.position_m,
            pad.sensors.axes,
            max(tolerance.sensor_position_m, LEAST_PLACE_M),
            max(tolerance.sensor_rotation_rad, LEAST_ROTATION_RAD),
            max(tolerance.gain, LEAST_GAIN),
        )

    def __len__(self) -> int:
        return len(self.place_m)


@dataclass(frozen=True, slots=True)
class Hand:
    """Where a person holds the magnet, by the instructions: means and deviations, in metres and without unit.

    offset_m, offset_sd_m (K, 3): of each step from the first; a person knows the direction of a movement, not its exact
    length. pole: +1 where the magnet's north pole points to +z, −1 where to −z, 0 where the person does not know.
    """

    offset_m: Array
    offset_sd_m: Array
    pole: int = 0
    middle_sd_m: float = 0.01
    height_m: float = 0.035
    log_height_sd: float = 0.7
    direction_sd: float = 0.4
    log_moment_sd: float = 0.03


STEP_M = 0.02
STEPS = np.array([[0.0, 0.0, 0.0], [STEP_M, 0.0, 0.0], [0.0, STEP_M, 0.0]])
ALONG_M, ACROSS_M, UP_M = 0.01, 0.006, 0.008
STEPS_SD = np.array([[0.0, 0.0, 0.0], [ALONG_M, ACROSS_M, UP_M], [ACROSS_M, ALONG_M, UP_M]])


def instructed_hand(pole: int = 0) -> Hand:
    """The hand of a person who follows the steps of the check."""
    return Hand(STEPS, STEPS_SD, pole)
