"""Facts of a configured pad for drawing it: places of its sensors, its magnet, and its placement."""

from __future__ import annotations

from typing import Any

from fmfts.config import PadConfig


def pad_facts(config: PadConfig) -> dict[str, Any]:
    """A pad's configured shape, in SI; the unit is in each key."""
    pad, placement = config.pad(), config.placement.si()
    several = {"rest_positions_m": [one.rest_position_m.tolist() for one in pad.magnets]} if pad.other_magnets else {}
    return several | {
        "rate_nominal_hz": float(config.source.rate_hz),
        "geometry_hash": pad.geometry_hash,
        "sensors_m": pad.sensors.position_m.tolist(),
        "rest_position_m": pad.rest_position_m.tolist(),
        "rest_axis": pad.rest_axis.tolist(),
        "magnet_diameter_m": pad.magnet.diameter_m,
        "magnet_length_m": pad.magnet.length_m,
        "placement_m": placement.position_m.tolist(),
        "placement_rotation": placement.rotation.tolist(),
    }
