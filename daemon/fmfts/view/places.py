"""Asks the running daemon for the places of its pads' sensors, which are not on the bus."""

from __future__ import annotations

from fmfts.view.surface import Places
from fmfts_client import ControlError, EndpointError, Endpoints, request

ANSWER_S = 0.5


def sensor_places(endpoints: Endpoints) -> dict[str, Places]:
    """x and y (m) of the sensors of each pad; empty if no daemon answers."""
    try:
        pads = request("pads", endpoint=endpoints, timeout_s=ANSWER_S)["pads"]
        return {pad["pad"]: [(float(x), float(y)) for x, y, _ in pad["sensors_m"]] for pad in pads}
    except (ControlError, EndpointError, KeyError, TypeError, ValueError):
        return {}
