"""Pads with two to four of the second standard pad's magnets, over eight to sixteen sensors."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from fmfts.config import GeometryConfig, PadConfig
from fmfts_lab.finite_elements.array_pad import array_config

STANDARD = array_config()
_ALONG_MM = (-13.5, -4.5, 4.5, 13.5)
GRID_MM = [(x, y, 0.0) for x in _ALONG_MM for y in _ALONG_MM]
WITHOUT_CORNERS_MM = [place for place in GRID_MM if abs(place[0]) + abs(place[1]) < 27.0]


def layout(magnets: Sequence[int], sensors_mm: Sequence[tuple[float, float, float]]) -> PadConfig:
    """The standard pad with some of its magnets, by number, over other sensors."""
    every = (STANDARD.magnet, *STANDARD.other_magnets)
    first, *others = (every[number] for number in magnets)
    return msgspec.structs.replace(
        STANDARD, magnet=first, other_magnets=tuple(others), geometry=GeometryConfig(sensors_mm=tuple(sensors_mm))
    )


_EIGHT_MM = STANDARD.geometry.sensors_mm
LAYOUTS = {
    "4 over 8": STANDARD,
    "2 over 8": layout((0, 3), _EIGHT_MM),
    "3 over 8": layout((0, 1, 2), _EIGHT_MM),
    "4 over 12": layout((0, 1, 2, 3), WITHOUT_CORNERS_MM),
    "4 over 16": layout((0, 1, 2, 3), GRID_MM),
}
