"""Finds impossible frames, which no working driver gives, before they are used."""

from __future__ import annotations

import math

import numpy as np

from fmfts.sensor.chips import Chip
from fmfts.sensor.frame import READING_BYTES, Frame, WireFrame

LARGEST = 1 << 62  # limit of any number of a frame, so that C can add two of them
LATEST_US = 1 << 53  # a board's clock, which C reckons in doubles: 285 years
EARLIEST_NS = 1_000_000_000  # a frame's time is at most this far in the future


def flaw_of(frame: Frame, sensors: int, now_ns: int) -> str:
    """Why a frame cannot be of a pad with so many sensors; "" if nothing is wrong. now_ns: CLOCK_MONOTONIC."""
    for name in ("sequence", "device_time_us", "host_time_ns", "gain_code", "run"):
        number = getattr(frame, name)
        if type(number) is not int or not 0 <= number < LARGEST:
            return f"a frame's {name} is {number!r}"
    if frame.device_time_us >= LATEST_US:
        return f"a frame's device_time_us is {frame.device_time_us}: its board has not run for 285 years"
    if frame.host_time_ns > now_ns + EARLIEST_NS:
        return f"a frame's time is {(frame.host_time_ns - now_ns) * 1e-9:.1f} s in the future"
    if not isinstance(frame.chip, Chip) or frame.gain_code >= len(frame.chip.step_t):
        return f"a frame's gain_code {frame.gain_code} does not exist on its chip"
    degrees = frame.temperature_c
    if degrees is not None and not (isinstance(degrees, int | float) and math.isfinite(degrees)):
        return f"a frame's temperature is {degrees!r}"
    if type(frame) is WireFrame:
        length = len(frame.packed[3])
        return "" if length == READING_BYTES * sensors else f"a frame has {length} bytes of readings"
    for name, kind, shape in (
        ("counts", np.int16, (sensors, 3)),
        ("age_us", np.uint16, (sensors,)),
        ("fresh", np.bool_, (sensors,)),
        ("valid", np.bool_, (sensors,)),
    ):
        array = getattr(frame, name)
        if not isinstance(array, np.ndarray) or array.dtype != kind or array.shape != shape:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            return f"a frame's {name} are {found} and not {np.dtype(kind)} {shape}"
    return ""
