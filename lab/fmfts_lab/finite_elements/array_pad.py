"""The second standard pad, four magnets over eight sensors, as a configuration."""

from __future__ import annotations

from fmfts.config import GeometryConfig, MagnetConfig, PadConfig, SimulatedSource
from fmfts.contact.array_model import STANDARD_SENSORS_MM

PLACES_M = ((6e-3, 6e-3), (6e-3, -6e-3), (-6e-3, 6e-3), (-6e-3, -6e-3))
HEIGHT_MM = 12.0


def array_config(name: str = "array", seed: int = 1, fingers: int = 1) -> PadConfig:
    """The second standard pad: magnets of alternating polarity at (±6, ±6) mm, eight sensors."""
    magnets = [
        MagnetConfig(rest_mm=(x * 1e3, y * 1e3, HEIGHT_MM), rest_axis=(0, 0, 1 if x * y > 0 else -1))
        for x, y in PLACES_M
    ]
    return PadConfig(
        name=name,
        source=SimulatedSource(seed=seed, range_gauss=8.1, fingers=2 if fingers == 2 else 1),
        geometry=GeometryConfig(sensors_mm=tuple((x, y, z) for x, y, z in STANDARD_SENSORS_MM.tolist())),
        magnet=magnets[0],
        other_magnets=tuple(magnets[1:]),
    )
