"""Physical limits of numbers that come from a wire, a file or a person; every reader checks them first.

The configuration has narrower limits, beside its keys, and so have the chips (sensor/chips).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Range(NamedTuple):
    """A closed range, with a name for people."""

    lowest: float
    highest: float
    of: str

    def holds(self, value: float) -> bool:
        """Whether the value is in the range; NaN is in none."""
        return self.lowest <= value <= self.highest

    def require(self, values: Iterable[float]) -> None:
        """ValueError names the first value that is out of the range."""
        for value in values:
            if not self.holds(value):
                # An integer of a file may be larger than a float can be.
                is_huge = isinstance(value, int) and value.bit_length() > 1000
                told = "an integer of more than 300 digits" if is_huge else f"{value:g}"
                raise ValueError(f"{told} is no {self.of}: from {self.lowest:g} to {self.highest:g}")


# The widest range of any chip, the MLX90393's 397 G, and a gain that is off. A chip's own range is narrower.
FIELD_T = Range(-5e-2, 5e-2, "field in T")
NOISE_T = Range(0.0, 1e-4, "noise in T")
GAIN = Range(0.1, 10.0, "gain")
SHARE = Range(0.0, 1.0, "share")
# Where silicone, solder and the chips' data sheets end. Each chip's own range is narrower (Thermometer).
TEMPERATURE_C = Range(-60.0, 150.0, "temperature in °C")
# A pad, and all that is learned about it, fits into a metre; a rotation vector ends at half a turn.
PLACE_M = Range(-1.0, 1.0, "place in m")
ROTATION_RAD = Range(-3.2, 3.2, "rotation in rad")
UNIT = Range(-1.000001, 1.000001, "component of a direction")
RECORDING_S = Range(0.0, 3600.0, "duration of a recording in s")
# Limits of tables of presses: any pad that a hand can hold. Their squares and quotients are numbers, too.
PLACE_MM = Range(-1e4, 1e4, "place in mm")
SPACING_MM = Range(1e-3, 1e3, "spacing in mm")
STIFFNESS = Range(0.05, 20.0, "stiffness over that of the contact model's pad")
FORCE_N = Range(1e-3, 1e5, "force in N")
SAMPLES = Range(1, 1e7, "number of samples")
# Limits of joint positions: motors' counts are angles, too, and a finger slides a metre at most.
MOST_JOINTS = 64  # of a hand
JOINT_RAD = Range(-1e3, 1e3, "joint position in rad")
JOINT_AXIS = Range(-1e3, 1e3, "coordinate per rad")
POLYNOMIAL_ORDER = Range(0.0, 20.0, "order of a polynomial")
FIELD_T2 = Range(-2.5e-3, 2.5e-3, "covariance of fields in T²")
INVERSE_NORMAL = Range(-1e9, 1e9, "inverse of a normal matrix")
