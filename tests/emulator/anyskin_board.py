"""What a ReSkin, AnySkin or eFlesh board sends, byte by byte, as its published sketches and their library do.

Sketches: raunaqbhirangi/reskin_sensor and raunaqbhirangi/anyskin, 5X_binary_burst_stream and 5X_burst_stream.
Library: tesshellebrekers/arduino-MLX90393, MLX90393.cpp: begin() sets HALLCONF 0xC, GAIN_SEL 6 and RES 0, and
convertRaw() multiplies counts by 32-bit floats. Counts: Melexis 3901090393 rev 002, table 4 (by RES: two's complement
of 16 bits that wraps around, or unsigned with an end at 22000 or 11000 counts). With RES 3 the library subtracts 2^14.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

XY_UT, Z_UT = np.float32(0.150), np.float32(0.242)  # base_xy_sens_hc0xc, base_z_sens_hc0xc
GAINS = tuple(np.float32(each) for each in (5, 4, 3, 2.5, 2, 1.66666667, 1.33333333, 1))  # by GAIN_SEL


class Settings(NamedTuple):
    """The settings of all chips of a board."""

    gain_sel: int = 6
    res: int = 0


BEGIN = Settings()  # the library's begin() sets it, and the published sketches keep it


def steps_ut(settings: Settings = BEGIN) -> tuple[float, float, float]:
    """Microtesla of a count in x, y and z."""
    factor = float(GAINS[settings.gain_sel]) * 2**settings.res
    return float(XY_UT) * factor, float(XY_UT) * factor, float(Z_UT) * factor


def told_ut(count: int, axis: int, settings: Settings = BEGIN) -> float:
    """convertRaw() of a count, in its order of 32-bit multiplications."""
    base = Z_UT if axis == 2 else XY_UT
    return float(np.float32(count) * base * GAINS[settings.gain_sel] * np.float32(1 << settings.res))


def quantised(field_ut: Sequence[float], settings: Settings = BEGIN) -> tuple[float, float, float]:
    """A field as the board sends it."""
    told = []
    for axis, (value, step) in enumerate(zip(field_ut, steps_ut(settings), strict=True)):
        count = round(value / step)
        if settings.res < 2:
            count = (count + 32768) % 65536 - 32768
        else:
            end = 22000 if settings.res == 2 else 11000
            count = max(-end, min(end, count))
        told.append(told_ut(count, axis, settings))
    x, y, z = told
    return x, y, z


def no_sample(settings: Settings = BEGIN) -> tuple[float, float, float, float]:
    """The values of 0xFFFF in every register: temperature, x, y, z."""
    count = (-1, -1, 65535 - 32768, 65535 - 16384)[settings.res]
    x, y, z = (told_ut(count, axis, settings) for axis in range(3))
    return 25 + (65535 - 46244) / 45.2, x, y, z


def binary(fields_ut: Sequence[Sequence[float]], temperature_c: float = 25.0, settings: Settings = BEGIN) -> bytes:
    """5X_binary_burst_stream: floats t, x, y, z of each magnetometer, and CR LF. A field of NaN: it has no sample."""
    numbers: list[float] = []
    for field_ut in fields_ut:
        numbers += no_sample(settings) if math.isnan(field_ut[0]) else (temperature_c, *quantised(field_ut, settings))
    return struct.pack(f"<{len(numbers)}f", *numbers) + b"\r\n"


def text(fields_ut: Sequence[Sequence[float]], temperature_c: float = 25.0, settings: Settings = BEGIN) -> bytes:
    """5X_burst_stream: two decimals, tabs within a magnetometer, and no separator between two of them."""
    parts = ["\t".join(f"{value:.2f}" for value in (temperature_c, *quantised(field, settings))) for field in fields_ut]
    return "".join(parts).encode() + b"\r\n"
