"""The map `slip` of a contact message: whether the finger slips over the silicone, and what its slips have taught."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional


@dataclass(frozen=True)
class Slip:
    """Everything is None where nothing is known: without a touch, and where the touch is too light.

    friction and margin_n, the tangential force that is left until it slips, are None before the first slip of a touch.

    direction_rad: of the finger over the silicone, from the pad's x toward y. Speed and direction mean something while
    it slips.
    """

    slipping: Optional[bool]
    sticking_probability: Optional[float]
    speed_m_per_s: Optional[float]
    speed_sd_m_per_s: Optional[float]
    direction_rad: Optional[float]
    direction_sd_rad: Optional[float]
    friction: Optional[float]
    friction_sd: Optional[float]
    margin_n: Optional[float]
    margin_sd_n: Optional[float]
