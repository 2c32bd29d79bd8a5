"""The published deviation of a force that is none: fmfts_force_sd_n in contact_of_pose.c."""

from __future__ import annotations

from math import sqrt

from fmfts.arithmetic.elementary import square


def felt_force_sd_n(quiet_sd_n: float, detection_limit_n: float) -> float:
    """The deviation (N) without the detection limit, of the published one while no touch is felt."""
    return sqrt(max(square(quiet_sd_n) - square(detection_limit_n) / 3.0, 0.0))
