"""The contact carried on from the newest sample to the time of publishing.

With F and its rate Ḟ at the newest sample, `lead` seconds before:

    force = F + LEAD_SHARE·Ḟ·lead, and place = x + ẋ·lead

A rate is shrunk by what is known of fingers (60 N/s, 120 mm/s: one deviation): r = r̂·P²/(P² + σ²). Its deviation counts
what the finger may accelerate within AHEAD_S. The deviation of a carried value is σ(F) + σ(Ḟ)·lead, as if both had the
same cause, because the filter's errors of a value and of its rate mostly do. `now.c` does the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.contact.drive import FORCE_DRIVE_N2_PER_S3, PLACE_DRIVE_MM2_PER_S3
from fmfts.pad import Array

FORCE_RATE_N_PER_S, PLACE_RATE_M_PER_S = 60.0, 0.12
# A press that is fast now turns round soon. With all of its rate the force would overshoot a tap's peak by 0.12 N.
LEAD_SHARE = 0.75
# The rates' deviations are right for readers that carry the contact on for so long.
AHEAD_S = 5e-3


@dataclass(frozen=True, slots=True)
class ContactNow:
    """The contact at `time_us` of the board's clock. values, rates (3,) or (5,): x, y (m), force, shear x, y (N), and
    these per second, with their deviations. touching: without a touch only the force means something."""

    time_us: float
    values: Array
    deviations: Array
    rates: Array
    rate_deviations: Array
    touching: bool

    @property
    def is_finite(self) -> bool:
        """Whether all of it are numbers."""
        told = np.concatenate([self.values, self.deviations, self.rates, self.rate_deviations])
        return bool(np.isfinite(told).all())


def shrunk(rates: Array, variance: Array, moving: float) -> tuple[Array, Array]:
    """Rates (m,) and their deviations (m,), from what the filter found. moving: probability that the finger moves."""
    prior, power = np.full(len(rates), FORCE_RATE_N_PER_S), np.full(len(rates), FORCE_DRIVE_N2_PER_S3)
    prior[:2], power[:2] = PLACE_RATE_M_PER_S, PLACE_DRIVE_MM2_PER_S3 * 1e-6
    share = square(prior) / (square(prior) + variance)
    return rates * share, np.sqrt(variance * share + moving * AHEAD_S * power)


def carried(
    time_us: float,
    lead_s: float,
    values: Array,
    deviations: Array,
    rates: Array,
    rate_deviations: Array,
    pressed: bool,
    touching: bool,
) -> ContactNow:
    """The contact `lead_s` after the newest sample. pressed: whether the magnet is certainly below its rest."""
    ahead = values + rates * lead_s
    ahead[2:] = values[2:] + LEAD_SHARE * lead_s * rates[2:]
    ahead[2] = max(float(ahead[2]), 0.0)
    if not pressed:
        ahead[2], rates[2] = 0.0, 0.0
    return ContactNow(time_us, ahead, deviations + rate_deviations * lead_s, rates, rate_deviations, touching)
