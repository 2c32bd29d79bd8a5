"""How much a pressed patch shrinks, seen from above: a pressure on it makes less force than on the area at rest.

python -m fmfts_lab.finite_elements.patch_area
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import Press, Slab
from fmfts_lab.finite_elements.slab_mesh import MM

PLACES_MM = ((0.0, 0.0), (8.0, 6.0))
FORCE_N = (0.2827, 1.131, 1.9792)
CORNERS = 360


def seen_area(pressed: PressedSlab, press: Press) -> float:
    """The area of the pressed patch, seen along z, divided by its area at rest."""
    pressed.solve(press)
    line, top = pressed.mesh.line_mm, pressed.mesh.on_top(pressed.displacement_mm)
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    rim = np.array([press.x_m, press.y_m]) * MM + pressed.slab.patch_diameter_m * MM / 2.0 * np.column_stack(
        [np.cos(angle), np.sin(angle)]
    )
    moved = rim + RegularGridInterpolator((line, line), top)(rim)[:, :2]
    return _area(moved) / _area(rim)


def _area(corner: np.ndarray) -> float:
    following = np.roll(corner, -1, axis=0)
    return float(np.sum(corner[:, 0] * following[:, 1] - corner[:, 1] * following[:, 0]) / 2.0)


def main() -> None:
    pressed = PressedSlab(Slab())
    for x_mm, y_mm in PLACES_MM:
        pressed.rest()
        for force_n in FORCE_N:
            share = seen_area(pressed, Press(x_mm * 1e-3, y_mm * 1e-3, force_n))
            print(f"({x_mm:g}, {y_mm:g}) mm, {force_n:g} N: {share:.4f}")


if __name__ == "__main__":
    main()
