"""Published boards of five chips according to their public files: each chip's place, and its rotation.

Typed from these sources, not from the daemon:
- pick-and-place and Gerber files in circuits/5X_ReSkin.Zip of raunaqbhirangi/reskin_sensor: reference points, rotations
  (counter-clockwise: the footprint's "Mid" turns so about its "Ref"), and what pins 11 and 12 are connected to;
- Melexis 3901090393 rev 002: pin 11 is A1, pin 12 is A0 (table 7), the address ends with A1, A0 (section 9); x points
  to the edge of pins 1 to 4, y to the edge of pins 5 to 8, z out of the top (figure 9). Pin 1 of the footprint is at
  its upper right where the rotation is 0;
- 5X_binary_burst_stream.ino of raunaqbhirangi/reskin_sensor and of raunaqbhirangi/anyskin: the order of the addresses.
"""

from __future__ import annotations

import numpy as np

MIL_MM = 0.0254
# Reference point in mil, rotation in degrees, pins 11 and 12.
PICK_AND_PLACE = {
    "U5": (2285.465, 3155.543, 270.0, "VDD", "VSS"),
    "U3": (2834.646, 3155.543, 360.0, "VSS", "VDD"),
    "U1": (2559.055, 3155.543, 0.0, "VSS", "VSS"),
    "U4": (2557.055, 2877.953, 90.0, "VSS", "VSS"),
    "U2": (2559.055, 3427.134, 180.0, "VDD", "VDD"),
}
REFERENCE_FROM_CENTRE_MIL = (0.0, 2.0)  # offset in the footprint at rotation 0: "Ref" less "Mid"
STREAMED = {"reskin5": (0x0C, 0x13, 0x12, 0x10, 0x11), "anyskin5": (0x0C, 0x0D, 0x0E, 0x0F, 0x10)}
TURNED_OVER = np.diag([-1.0, 1.0, -1.0])  # about y


def turned(degrees: float) -> np.ndarray:
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def chips(board: str) -> tuple[np.ndarray, np.ndarray]:
    """Places in mm (5, 3) and axes (5, 3, 3) in the order of the stream; columns are the chip's x, y and z.

    The address 0x10 is of a chip whose order code begins at 0x10; of reskin5 all chips but the first are such.
    """
    name = board.removesuffix("_back")
    middle = np.array(PICK_AND_PLACE["U1"][:2]) - REFERENCE_FROM_CENTRE_MIL
    places, axes = [], []
    for address in STREAMED[name]:
        levels = ("VDD" if address & 2 else "VSS", "VDD" if address & 1 else "VSS")
        named = [each for each, facts in PICK_AND_PLACE.items() if facts[3:] == levels]
        # U1 and U4 have the same levels: the middle one is 0x0C, as both firmwares' viewers draw it.
        (designator,) = named if len(named) == 1 else ["U1" if address == 0x0C else "U4"]
        x, y, rotation, *_ = PICK_AND_PLACE[designator]
        centre = np.array([x, y]) - turned(rotation)[:2, :2] @ REFERENCE_FROM_CENTRE_MIL
        places.append([*(MIL_MM * (centre - middle)), 0.0])
        figure_9 = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x up, y to the left
        axes.append(turned(rotation) @ figure_9)
    if board != name:
        return np.array(places) @ TURNED_OVER, TURNED_OVER @ np.array(axes)
    return np.array(places), np.array(axes)
