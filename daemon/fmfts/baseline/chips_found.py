"""A sentence about each chip's errors, for the person who recorded the baseline."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length
from fmfts.baseline.mounting import Mounting
from fmfts.baseline.sensitivity import relative_covariance

Array = NDArray[np.float64]

# A rotation or a gain is named if it differs from the drawing's by this many of its deviations.
NAMED_DEVIATIONS = 3.0
# A direction gets the name of a pad's axis if this share of it is along that axis.
MOSTLY = 0.9


def chips_found(mounting: Mounting) -> str:
    """For example "sensor 3 is turned by 1.2° about z; gains are 1.8 % apart"; "" if no chip is known to be off."""
    if mounting.leftover is None:
        return ""
    unknowns, first = mounting.leftover.unknowns, 9 + 3 * len(mounting.gain)
    scale = unknowns.deviation[first:]
    covariance = mounting.leftover.covariance[first:, first:] * scale * scale[:, None]
    values = unknowns.sensitivity + scale * mounting.leftover.scaled[first:]
    deviation = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)).reshape(3, -1, 3)
    gains, rotations, _ = values.reshape(3, -1, 3)
    told = [_turned(sensor, rotations[sensor], deviation[1, sensor]) for sensor in range(len(rotations))]
    apart_deviation = float(np.sqrt(np.diagonal(relative_covariance(covariance))[: gains.size].max()))
    if np.ptp(gains) > NAMED_DEVIATIONS * math.sqrt(2.0) * apart_deviation:
        told.append(f"gains are {np.ptp(gains) * 100:.1f} % apart")
    return "; ".join(sentence for sentence in told if sentence)


def _turned(sensor: int, rotation_rad: Array, deviation_rad: Array) -> str:
    if not (np.abs(rotation_rad) > NAMED_DEVIATIONS * deviation_rad).any():
        return ""
    angle = length(rotation_rad)
    along = rotation_rad / angle
    axis = int(np.argmax(np.abs(along)))
    sign = "−" if along[axis] < 0.0 else ""
    about = (
        f"{sign}{'xyz'[axis]}" if abs(along[axis]) > MOSTLY else "(" + ", ".join(f"{one:.1f}" for one in along) + ")"
    )
    return f"sensor {sensor + 1} is turned by {math.degrees(angle):.1f}° about {about}"
