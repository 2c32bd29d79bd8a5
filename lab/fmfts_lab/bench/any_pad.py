"""Pads of any silicone, thickness and finger: before anything is measured, after one weight, and after five presses.

Thickness and finger are drawn from those that CalculiX solved (cast_pads.py), Poisson's ratio evenly, and the modulus
evenly in its logarithm. A gauge as wide as the finger makes the five presses; the weight stands on WEIGHED_BY_MM.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fmfts.baseline import BaselineError
from fmfts_lab.bench import few_presses
from fmfts_lab.bench.cast_pads import unsheared_pads
from fmfts_lab.bench.structure import Cell, Found
from fmfts_lab.bench.weigh import Bench, facts_of, line

MODULI, POISSONS = (0.5, 2.0), (0.47, 0.4999)
WEIGHED_BY_MM = 6.0
PRESSES = 5
WHEN = ("before weighing", "after one weight", "and finger_mm named", f"after {PRESSES} presses")


def drawn(seed: int) -> Cell:
    random = np.random.default_rng(seed)
    modulus, poisson = float(np.exp(random.uniform(*np.log(MODULI)))), float(random.uniform(*POISSONS))
    solved = unsheared_pads()
    cast = solved[int(random.integers(len(solved)))]
    name = f"modulus × {modulus:.2f}, Poisson {poisson:.4f}, {cast.thickness_mm:g} mm, finger {cast.finger_mm:g} mm"
    return Cell(name, modulus, cast.thickness_mm, cast.finger_mm, poisson=poisson)


class Trial:
    """One pad. found: in the order of WHEN. refused: what the daemon said where it took no weight or no presses."""

    def __init__(self, seed: int, options: Namespace) -> None:
        self.cell = cell = drawn(seed)
        self.found = [Found() for _ in WHEN]
        self.refused: list[str] = []
        bench, seconds = Bench(cell, WEIGHED_BY_MM, seed), options.seconds
        if options.refine:
            bench.baseline = few_presses.refined(bench, cell, np.random.default_rng([seed, PRESSES]))
        bench.presses(cell, bench.baseline, seconds, self.found[0])
        try:
            weighed, _ = bench.in_the_middle()
        except BaselineError as error:
            self.refused.append(str(error))
        else:
            bench.presses(cell, weighed, seconds, self.found[1])
            contact = msgspec.structs.replace(bench.config.contact, finger_mm=(cell.finger_mm, cell.finger_mm))
            named = msgspec.structs.replace(bench.config, contact=contact)
            bench.presses(cell, weighed, seconds, self.found[2], named)
        row = few_presses.Row(cell.name, self.found[3])
        asked = Namespace(seconds=seconds, refine=options.refine, without=())
        few_presses.trial(cell, PRESSES, seed, asked, None, row)
        self.refused += row.refused

    @property
    def facts(self) -> dict[str, Any]:
        found = {when: facts_of([each]) for when, each in zip(WHEN, self.found, strict=True) if each.frames}
        return {"cell": self.cell.name, "refused": self.refused} | found


def run(options: Namespace) -> None:
    trials = []
    for seed in range(options.seed, options.seed + options.pads):
        trials.append(Trial(seed, options))
        print(f"{trials[-1].cell.name} {'; '.join(trials[-1].refused)}", flush=True)
        for when, found in zip(WHEN, trials[-1].found, strict=True):
            if found.frames:
                print(f"    {when:20} {line(facts_of([found]))}", flush=True)
    for number, when in enumerate(WHEN):
        all_found = [each.found[number] for each in trials if each.found[number].frames]
        print(f"{when} ({len(all_found)} of {len(trials)} pads): {line(facts_of(all_found))}")
    if options.out:
        facts = [each.facts for each in trials]
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(facts)) + b"\n")
