"""A foreign field, of steel or another magnet: unknown, and not uniform over the pad."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.pose.problem import Part, Parts, Prior
from fmfts.pose.state import AMBIENT, GRADIENT, SIZE

# The gradient that a magnet 60 mm away or a steel tool makes: 22 mG from the middle of the pad to a sensor.
GRADIENT_DEVIATION_T_PER_M = 3e-4
UNIFORM_DEVIATION_T = 1e-5
FOREIGN_DEVIATION = np.zeros(SIZE)
FOREIGN_DEVIATION[AMBIENT], FOREIGN_DEVIATION[GRADIENT] = UNIFORM_DEVIATION_T, GRADIENT_DEVIATION_T_PER_M


def with_foreign_field(parts: Parts, prior: Prior) -> tuple[Parts, Prior]:
    """Add a foreign field to the unknowns: a gradient, and a uniform part if the ambient field is fixed."""
    parts, covariance = parts.copy(), prior.covariance.copy()
    parts[GRADIENT] = Part.PRIOR
    covariance[GRADIENT, GRADIENT] = np.eye(5) * square(GRADIENT_DEVIATION_T_PER_M)
    if parts[AMBIENT.start] == Part.FIXED:
        parts[AMBIENT] = Part.PRIOR
        covariance[AMBIENT, AMBIENT] = np.eye(3) * square(UNIFORM_DEVIATION_T)
    return parts, replace(prior, covariance=covariance)
