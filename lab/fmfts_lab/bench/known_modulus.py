"""Useless weights on pads whose modulus is known to 5 %: are they refused, or within their deviations?

50 g that are called 100 g and the other way round, a weight 3.6 mm from the middle, and one that a hand holds.
"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter

import numpy as np

from fmfts.baseline import BaselineError
from fmfts.baseline.silicone import StoredSilicone
from fmfts.config import ToleranceConfig
from fmfts_lab.bench.structure import Cell
from fmfts_lab.bench.weigh import ASIDE_M, MIDDLE_M, PADS_MM, WEIGHTS_N, Bench, shaken
from fmfts_simulation.finger import Finger, steady_finger

MODULUS = 0.05
HONEST_DEVIATIONS = 2.0


def weights() -> list[tuple[str, float, Finger]]:
    """The weight that is entered, in N, and the press that it makes."""
    found = []
    for said_n in WEIGHTS_N:
        for true_n in WEIGHTS_N:
            name = "right" if said_n == true_n else "half of what is said" if true_n < said_n else "twice what is said"
            found.append((name, said_n, steady_finger(*MIDDLE_M, true_n)))
        found.append(("aside", said_n, steady_finger(*ASIDE_M, said_n)))
        found.append(("hand", said_n, shaken(said_n)))
    return found


def run(options: Namespace) -> None:
    said = Counter[tuple[str, str]]()
    for seed in range(options.seed, options.seed + options.pads):
        for thickness_mm, by_mm in sorted({(thick, by) for thick, by, _ in PADS_MM}):
            random = np.random.default_rng([seed, round(10.0 * thickness_mm), round(by_mm)])
            cell = Cell("known", float(np.exp(MODULUS * random.standard_normal())), thickness_mm, by_mm)
            bench = Bench(cell, by_mm, seed, ToleranceConfig(gain=0.005, modulus=MODULUS))
            # A slab of another thickness has another scale, and a right weight tells it.
            is_drawn = thickness_mm == PADS_MM[0][0]
            truth = cell.modulus if is_drawn else _stiffness(bench, *weights()[0][1:]).stiffness
            for name, said_n, finger in weights():
                said[name, f"{thickness_mm:g} mm: {_outcome(bench, truth, said_n, finger)}"] += 1
    for (name, outcome), count in sorted(said.items()):
        print(f"{name}, {outcome}: {count}")


def _stiffness(bench: Bench, said_n: float, finger: Finger) -> StoredSilicone:
    silicone = bench.weighed(bench.baseline, said_n, finger).silicone
    assert silicone is not None
    return silicone


def _outcome(bench: Bench, truth: float, said_n: float, finger: Finger) -> str:
    try:
        silicone = _stiffness(bench, said_n, finger)
    except BaselineError as error:
        return "refused" + (", not in the middle" if "from the middle" in str(error) else "")
    off = abs(np.log(silicone.stiffness / truth)) / silicone.deviation
    return "accepted, " + ("right" if off <= HONEST_DEVIATIONS else "off by more than two deviations")
