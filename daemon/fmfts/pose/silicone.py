"""Parameters of the creep of silicone; silicone.c has the model."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.pad import Array, Silicone

# One for each decade after the second in which a calibration measures ([collect] settle_s, average_s).
TIMES_S = np.array([1.0, 10.0, 100.0, 1000.0])
# Deviation of each decade's creep, in the creep that is configured. Decades count as independent, but all creep the
# same way; so the deviation of a long hold is six tenths of what it creeps by.
DECADE_DEVIATION = 1.25


def silicone_fields(silicone: Silicone, longest_gap_s: float) -> dict[str, float | Array]:
    """What silicone.c needs. longest_gap_s: between two frames; after a longer one the load in between is unknown."""
    return {
        "silicone_share": float(root_of_squares(silicone.hysteresis, silicone.creep_per_decade)),
        "creep_share": DECADE_DEVIATION * silicone.creep_per_decade,
        "unseen_gap_s": longest_gap_s,
        "creep_time_s": TIMES_S,
    }
