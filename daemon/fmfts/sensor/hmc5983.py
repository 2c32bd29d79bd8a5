"""The HMC5983 three-axis magnetometer: registers and what their numbers mean (Honeywell data sheet 900425)."""

from __future__ import annotations

ADDRESS = 0x1E
# Gain code (CRB bits 7–5) → counts per gauss and the largest field per axis, both from the gain table.
LSB_PER_GAUSS = (1370, 1090, 820, 660, 440, 390, 330, 230)
RANGE_GAUSS = (0.88, 1.3, 1.9, 2.5, 4.0, 4.7, 5.6, 8.1)
OVERFLOW_COUNT = -4096


def gain_code_for_range(range_gauss: float) -> int:
    """The gain code whose range is `range_gauss`; ValueError names the ranges that exist."""
    for code, value in enumerate(RANGE_GAUSS):
        if abs(value - range_gauss) < 1e-9:
            return code
    raise ValueError(f"the chip has no range of ±{range_gauss} G: one of {', '.join(map(str, RANGE_GAUSS))}")
