"""How a press depends on the Poisson's ratio of the silicone: is the magnet's movement linear in it?

python -m fmfts_lab.finite_elements.poisson

Solved by felupe, whose elements have one mean pressure each and do not lock: those of CalculiX do from about 0.495 on.
Young's modulus is the same in all.
"""

from __future__ import annotations

import numpy as np

from fmfts_lab.finite_elements.cast_presses import ELEMENT_M, POISSON, SOFTER_POISSON, silicone
from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import Press

RATIOS = (0.48, 0.499, 0.4999)
PLACES_M = ((0.7e-3, 0.4e-3), (6.2e-3, 2.6e-3))
FORCE_N = 0.3  # more is not found in one step from 0.499 on


def moved(poisson: float, place_m: tuple[float, float]) -> np.ndarray:
    displacement_m, axis = PressedSlab(silicone(poisson), ELEMENT_M).solve(Press(*place_m, FORCE_N))
    return np.array([*displacement_m, *axis[:2]])


def main() -> None:
    for place_m in PLACES_M:
        usual, softer = moved(POISSON, place_m), moved(SOFTER_POISSON, place_m)
        where = f"({place_m[0] * 1e3:g}, {place_m[1] * 1e3:g}) mm"
        print(f"{where}: Poisson {SOFTER_POISSON:g} moves {np.round(100.0 * (softer / usual - 1.0), 2)} % more")
        for ratio in RATIOS:
            share = (ratio - POISSON) / (SOFTER_POISSON - POISSON)
            linear = (1.0 - share) * usual + share * softer
            more, off = (
                100.0 * (one / other - 1.0) for one, other in ((linear, usual), (moved(ratio, place_m), linear))
            )
            print(f"    {ratio:g}: {np.round(more, 2)} % more if linear; solved {np.round(off, 2)} % beside that")


if __name__ == "__main__":
    main()
