"""A field from elsewhere, steel's or another magnet's: uneven over the pad, and unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.pose.problem import Part, Parts, Prior
from fmfts.pose.state import AMBIENT, GRADIENT, SIZE

# What a magnet 60 mm away, or a steel tool, makes: 22 mG from the middle to a sensor.
GRADIENT_DEVIATION_T_PER_M = 3e-4
UNEVEN_FIELD_DEVIATION_T = 1e-5
FOREIGN_DEVIATION = np.zeros(SIZE)
FOREIGN_DEVIATION[AMBIENT], FOREIGN_DEVIATION[GRADIENT] = UNEVEN_FIELD_DEVIATION_T, GRADIENT_DEVIATION_T_PER_M


def with_foreign_field(parts: Parts, prior: Prior) -> tuple[Parts, Prior]:
    """The same unknowns and that field's: a gradient, and an even part where the scene's ambient field is known."""
    parts, covariance = parts.copy(), prior.covariance.copy()
    parts[GRADIENT] = Part.PRIOR
    covariance[GRADIENT, GRADIENT] = np.eye(5) * square(GRADIENT_DEVIATION_T_PER_M)
    if parts[AMBIENT.start] == Part.FIXED:
        parts[AMBIENT] = Part.PRIOR
        covariance[AMBIENT, AMBIENT] = np.eye(3) * square(UNEVEN_FIELD_DEVIATION_T)
    return parts, replace(prior, covariance=covariance)
