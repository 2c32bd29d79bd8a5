"""Where the chips of published boards are, and how they are turned, by the name in `[pad.geometry] board`.

Places, turns and address pins: the layout 5X_ReSkin.Zip of raunaqbhirangi/reskin_sensor (pick-and-place and Gerber
files); AnySkin's board looks the same. Orders: the addresses in both firmwares (5X_binary_burst_stream).
docs/anyskin.md has what is confirmed, and what is not.

Pad axes: z out of the face with the chips, the connector at −y. Of `…_back` z is out of the other face, and the
connector is at −y, too.
"""

from __future__ import annotations

import math
from typing import Literal

from fmfts.config.section import Vector

BoardName = Literal["anyskin5", "anyskin5_back", "reskin5", "reskin5_back"]

# Designator → place in mm, and the rotation in degrees of the chip's x from the pad's: that of pick-and-place, which is
# counter-clockwise, and 90, since x points to the edge with pins 1 to 4 (Melexis 3901090393 rev 002, figure 9). A chip
# that is not turned has this edge at +y.
_CHIPS: dict[str, tuple[float, float, float]] = {
    "U1": (0.0, 0.0, 90.0),
    "U2": (0.0, 7.0, -90.0),
    "U3": (7.0, 0.0, 90.0),
    "U4": (0.0, -7.0, 180.0),
    "U5": (-7.0, 0.05, 0.0),
}
# Sine and cosine of half of each turn.
_DIAGONAL = math.sqrt(0.5)
_OF_HALF = {0.0: (0.0, 1.0), 90.0: (_DIAGONAL, _DIAGONAL), -90.0: (-_DIAGONAL, _DIAGONAL), 180.0: (1.0, 0.0)}
# In the order of the stream: addresses 0x0C, 0x13, 0x12, 0x10, 0x11, and 0x0C, 0x0D, 0x0E, 0x0F, 0x10. The pins A1 and
# A0 are both low at U1 and U4, both high at U2; A0 alone is high at U3, A1 alone at U5.
_ORDERS = {"reskin5": ("U1", "U2", "U5", "U4", "U3"), "anyskin5": ("U1", "U3", "U5", "U2", "U4")}


def layout(board: BoardName) -> tuple[tuple[Vector, ...], tuple[Vector, ...]]:
    """sensors_mm and sensor_rotations_deg of a board."""
    name, back, _ = board.partition("_back")
    chips = [_CHIPS[designator] for designator in _ORDERS[name]]
    if back:  # half a turn about y, after the chip's own about z
        halves = [_OF_HALF[turn] for _, _, turn in chips]
        rotations = tuple((180.0 * sine, 180.0 * cosine, 0.0) for sine, cosine in halves)
        return tuple((0.0 - x, y, 0.0) for x, y, _ in chips), rotations
    return tuple((x, y, 0.0) for x, y, _ in chips), tuple((0.0, 0.0, turn) for _, _, turn in chips)
