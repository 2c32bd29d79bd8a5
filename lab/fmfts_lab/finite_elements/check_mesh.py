"""Solves the same presses with finer and finer elements, to see how far the standard pad's table is from the limit.

python -m fmfts_lab.finite_elements.check_mesh [--element-mm 2 1.33 1 0.8] [--force-n 1]

0.8 mm takes a minute of one core and 3 GB.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import Press, Slab

PLACES_MM = ((0.0, 0.0), (8.0, 6.0))


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.finite_elements.check_mesh")
    parser.add_argument("--element-mm", type=float, nargs="+", default=[2.0, 4.0 / 3.0, 1.0, 0.8])
    parser.add_argument("--force-n", type=float, default=1.0)
    options = parser.parse_args(arguments)
    print(f"under {options.force_n:g} N: elements, layers of them, then at each place depth and tilt of the magnet")
    for element_mm in options.element_mm:
        pressed = PressedSlab(Slab(), element_mm * 1e-3)
        cells = []
        for x_mm, y_mm in PLACES_MM:
            pressed.rest()
            displacement_m, axis = pressed.solve(Press(x_mm * 1e-3, y_mm * 1e-3, options.force_n))
            cells.append(f"({x_mm:g}, {y_mm:g}) {-displacement_m[2] * 1e6:8.1f} µm {_tilt_mrad(axis):6.2f} mrad")
        layers = len(pressed.mesh.height_mm) - 1
        print(f"{element_mm:5.2f} mm {layers:3d}   " + "   ".join(cells), flush=True)
    return 0


def _tilt_mrad(axis: np.ndarray) -> float:
    return float(np.linalg.norm(axis[:2]) * 1e3)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
