"""50 g that are called 100 g, and the other way round, on pads whose modulus is known to 5 %: are they refused?"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter

import numpy as np

from fmfts.baseline import BaselineError
from fmfts.config import ToleranceConfig
from fmfts.simulation.finger import steady_finger
from fmfts_lab.bench.structure import Cell
from fmfts_lab.bench.weigh import MIDDLE_M, PADS_MM, WEIGHTS_N, Bench

MODULUS = 0.05
HONEST_DEVIATIONS = 2.0


def run(options: Namespace) -> None:
    said = Counter[tuple[str, str]]()
    for seed in range(options.seed, options.seed + options.pads):
        for thickness_mm, by_mm in sorted({(thick, by) for thick, by, _ in PADS_MM}):
            random = np.random.default_rng([seed, round(10.0 * thickness_mm), round(by_mm)])
            cell = Cell("known", float(np.exp(MODULUS * random.standard_normal())), thickness_mm, by_mm)
            bench = Bench(cell, by_mm, seed, ToleranceConfig(gain=0.005, modulus=MODULUS))
            for said_n in WEIGHTS_N:
                for true_n in WEIGHTS_N:
                    kind = f"{thickness_mm:g} mm, {'right' if said_n == true_n else 'off by a factor of two'}"
                    said[kind, _outcome(bench, cell, said_n, true_n)] += 1
    for (kind, outcome), count in sorted(said.items()):
        print(f"{kind}: {count} {outcome}")


def _outcome(bench: Bench, cell: Cell, said_n: float, true_n: float) -> str:
    """A slab of another thickness has another scale in the middle, and that is what a weight tells."""
    try:
        silicone = bench.weighed(bench.baseline, said_n, steady_finger(*MIDDLE_M, true_n)).silicone
    except BaselineError:
        return "refused"
    assert silicone is not None
    if cell.thickness_mm != PADS_MM[0][0]:
        return "taken"
    off = abs(np.log(silicone.stiffness / cell.modulus)) / silicone.deviation
    return "taken, " + ("right" if off <= HONEST_DEVIATIONS else "off by more than two deviations")
