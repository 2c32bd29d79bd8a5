"""What a ReSkin, AnySkin or eFlesh board sends, byte by byte, as its published sketches do (raunaqbhirangi/anyskin)."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

XY_STEP_UT, Z_STEP_UT = 0.161, 0.294  # the library's, at GAIN_SEL 7 and RES 0
NO_SAMPLE = (451.8, -XY_STEP_UT, -XY_STEP_UT, -Z_STEP_UT)  # what 0xFFFF in every register becomes


def quantised(field_ut: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (
        round(value / step) * step for value, step in zip(field_ut, (XY_STEP_UT, XY_STEP_UT, Z_STEP_UT), strict=True)
    )
    return x, y, z


def binary(fields_ut: Sequence[Sequence[float]], temperature_c: float = 25.0) -> bytes:
    """5X_binary_burst_stream: floats t, x, y, z of each magnetometer, and CR LF. A field of NaN: it has no sample."""
    numbers: list[float] = []
    for field_ut in fields_ut:
        numbers += NO_SAMPLE if math.isnan(field_ut[0]) else (temperature_c, *quantised(field_ut))
    return struct.pack(f"<{len(numbers)}f", *numbers) + b"\r\n"


def text(fields_ut: Sequence[Sequence[float]], temperature_c: float = 25.0) -> bytes:
    """5X_burst_stream: two decimals, tabs within a magnetometer, and nothing between two of them."""
    parts = ["\t".join(f"{value:.2f}" for value in (temperature_c, *quantised(field))) for field in fields_ut]
    return "".join(parts).encode() + b"\r\n"
