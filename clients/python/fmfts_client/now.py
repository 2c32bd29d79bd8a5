"""The map `now` of a contact message: the contact when the message was published, and how to carry it on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Optional

# Further ahead a fast press may already be reversing, so a rate is useless.
FARTHEST_S = 0.02


@dataclass(frozen=True)
class Now:
    """The contact at `t_ns` of the daemon's clock, its rates, and their deviations. Place: None without a touch."""

    t_ns: int
    x_m: Optional[float]
    x_sd_m: Optional[float]
    x_rate_m_per_s: Optional[float]
    x_rate_sd_m_per_s: Optional[float]
    y_m: Optional[float]
    y_sd_m: Optional[float]
    y_rate_m_per_s: Optional[float]
    y_rate_sd_m_per_s: Optional[float]
    force_n: float
    force_sd_n: float
    force_rate_n_per_s: float
    force_rate_sd_n_per_s: float
    shear_x_n: Optional[float]
    shear_x_sd_n: Optional[float]
    shear_x_rate_n_per_s: Optional[float]
    shear_x_rate_sd_n_per_s: Optional[float]
    shear_y_n: Optional[float]
    shear_y_sd_n: Optional[float]
    shear_y_rate_n_per_s: Optional[float]
    shear_y_rate_sd_n_per_s: Optional[float]

    def carried(self, ahead_s: float) -> Optional[Now]:
        """The same contact `ahead_s` later: value + rate · ahead, deviation + rate's deviation · |ahead|, force ≥ 0.

        None farther than FARTHEST_S.
        """
        if not abs(ahead_s) <= FARTHEST_S:
            return None
        changed: dict[str, Optional[float]] = {}
        for name, unit in (("x", "m"), ("y", "m"), ("force", "n"), ("shear_x", "n"), ("shear_y", "n")):
            changed[f"{name}_{unit}"] = _along(self, f"{name}_{unit}", f"{name}_rate_{unit}_per_s", ahead_s)
            changed[f"{name}_sd_{unit}"] = _along(
                self, f"{name}_sd_{unit}", f"{name}_rate_sd_{unit}_per_s", abs(ahead_s)
            )
        changed["force_n"] = max(changed["force_n"] or 0.0, 0.0)
        return replace(self, t_ns=self.t_ns + round(ahead_s * 1e9), **changed)  # type: ignore[arg-type]


def _along(now: Now, value: str, rate: str, ahead_s: float) -> Optional[float]:
    begin, slope = getattr(now, value), getattr(now, rate)
    return None if begin is None or slope is None else begin + slope * ahead_s
