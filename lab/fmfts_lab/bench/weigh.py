"""Pads of other silicone, before and after a weight told it: are forces right, and within their deviations?"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.request import BaselineRequest
from fmfts.config import PadConfig, ToleranceConfig
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.weighing import Weighing
from fmfts_lab.bench.silicone import RealPad, baseline_of, messages_of
from fmfts_lab.bench.structure import Cell, Found, cast_pad, config_of
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import Truth
from fmfts_simulation.finger import Finger, Touch, steady_finger

# Thickness, what stands on the silicone under the weight, and what presses afterwards: Solved with CalculiX.
PADS_MM = (
    (4.0, 6.0, 6.0),
    (4.0, 6.0, 3.0),
    (4.0, 6.0, 12.0),
    (4.0, 12.0, 6.0),
    (4.0, 3.0, 6.0),
    (3.6, 6.0, 6.0),
    (3.6, 12.0, 12.0),
    (4.4, 6.0, 6.0),
    (4.4, 3.0, 3.0),
)
MODULI = {PADS_MM[0]: (0.5, 0.7, 1.0, 1.4, 2.0)}  # which other frames: the first, the middle and the last
MIDDLE_M, ASIDE_M = (0.7e-3, 0.4e-3), (3.4e-3, 1.3e-3)
WEIGHTS_N = (0.981, 0.490)  # 100 g; where that is too much for a soft pad, 50 g
# What an owner states who does not know the silicone's cure: silicone twice as stiff is two deviations away.
ANY_CURE = ToleranceConfig(gain=0.005, modulus=0.5)
# A hand that still holds the weight trembles and sways.
SHAKEN = ((6.0, 0.02), (0.4, 0.03))  # Hz, and share of the weight


def shaken(force_n: float) -> Finger:
    def finger(time_s: float) -> Touch:
        moved = sum(share * np.sin(2.0 * np.pi * rate_hz * time_s) for rate_hz, share in SHAKEN)
        return Touch(*MIDDLE_M, force_n * (1.0 + float(moved)))

    return finger


class Bench:
    """One built pad under its weights. by_mm: how wide what the weight stands on is. remanence_t: of its magnet; None:
    nearly as drawn. noise_t: of a sample; None: the chip's."""

    noise_t: float | None = None

    def __init__(
        self,
        cell: Cell,
        by_mm: float,
        seed: int,
        tolerance: ToleranceConfig = ANY_CURE,
        remanence_t: float | None = None,
    ) -> None:
        self.config = msgspec.structs.replace(config_of(cell, 0.0, seed, "tolerances"), tolerance=tolerance)
        self._remanence_t = remanence_t
        self._weighed_by = replace(cell, finger_mm=by_mm)
        self._by_m = by_mm * 1e-3
        self._seed = seed
        self.baseline = baseline_of(self.config, self.pad(cell), turn=True)

    def pad(self, cell: Cell) -> RealPad:
        source = cast_pad(self.config, cell, 0.0, 0.0, self.noise_t)
        if self._remanence_t is not None:
            built = source.built
            magnet = built.pad.magnet.with_remanence(self._remanence_t)
            source.stands(replace(built, pad=replace(built.pad, magnet=magnet)))
        return source

    def weighed(self, before: Baseline, said_n: float, finger: Finger, by_m: float | None = None) -> Baseline:
        """BaselineError says why it is refused."""
        source = self.pad(self._weighed_by)
        source.finger = finger
        learn = Weighing(self.config, said_n, self._by_m if by_m is None else by_m)
        request = BaselineRequest(self.config.pad(), self.config.tolerance.si(), False, False, learn=learn)
        request.require_rest(before)
        return request.make(source.recorded(request.seconds), before)[0]

    def in_the_middle(self) -> tuple[Baseline, float]:
        """With the heavier weight, or, where that is more than the model knows, with the lighter one."""
        for weight_n in WEIGHTS_N:
            try:
                return self.weighed(self.baseline, weight_n, steady_finger(*MIDDLE_M, weight_n)), weight_n
            except BaselineError as error:
                if weight_n == WEIGHTS_N[-1] or "take half of it" not in str(error):
                    raise
        raise AssertionError

    def refusals(self, weighed: Baseline, weight_n: float) -> dict[str, str]:
        """What is said of weights that tell nothing, each after a good one; "" where the pad is misled: it is not
        refused, and the stiffness is off by more than two deviations from the good one's."""
        wrong = {
            "aside": (weight_n, steady_finger(*ASIDE_M, weight_n)),
            "half of what is said": (2.0 * weight_n, steady_finger(*MIDDLE_M, weight_n)),
            "hand": (weight_n, shaken(weight_n)),
        }
        return {name: self._said(weighed, *each) for name, each in wrong.items()}

    def _said(self, weighed: Baseline, said_n: float, finger: Finger) -> str:
        try:
            silicone = self.weighed(weighed, said_n, finger).silicone
        except BaselineError as error:
            return str(error)
        assert silicone is not None
        assert weighed.silicone is not None
        off = abs(np.log(silicone.stiffness / weighed.silicone.stiffness)) / silicone.deviation
        return "" if off > 2.0 else f"right to {off:.1f} deviations"

    def presses(
        self, cell: Cell, baseline: Baseline, seconds: float, found: Found, config: PadConfig | None = None
    ) -> None:
        """config: of the daemon that reads them; None: as at the baseline."""
        config = config or self.config
        pipeline = without_baseline(config, load_contact_model(config))
        pipeline.use(baseline)
        source = self.pad(cell)
        finger = cell.finger(np.random.default_rng(self._seed))
        source.finger = finger
        found.saw(messages_of(pipeline, source.recorded(seconds)), Truth(source.built, finger), finger, 0.0)


@dataclass(slots=True)
class Row:
    """One kind of pad. refused: good weights. misled: by wrong ones; `said` has what was said of each, for each pad.
    stiffness: as weighed."""

    cell: Cell
    by_mm: float
    before: Found = field(default_factory=Found)
    after: Found = field(default_factory=Found)
    refused: list[str] = field(default_factory=list)
    misled: list[str] = field(default_factory=list)
    said: list[dict[str, str]] = field(default_factory=list)
    stiffness: list[float] = field(default_factory=list)

    def build(self, seed: int, seconds: float) -> None:
        bench = Bench(self.cell, self.by_mm, seed)
        bench.presses(self.cell, bench.baseline, seconds, self.before)
        try:
            weighed, weight_n = bench.in_the_middle()
        except BaselineError as error:
            self.refused.append(str(error))
            return
        assert weighed.silicone is not None
        self.stiffness.append(weighed.silicone.stiffness)
        bench.presses(self.cell, weighed, seconds, self.after)
        said = bench.refusals(weighed, weight_n)
        self.said.append(said)
        self.misled += [name for name, words in said.items() if not words]

    @property
    def facts(self) -> dict[str, Any]:
        told = {"cell": self.cell.name, "by_mm": self.by_mm, "stiffness": self.stiffness}
        told |= {
            "refused": self.refused,
            "misled": self.misled,
            "wrong_weights": self.said,
            "before": facts_of([self.before]),
        }
        return told | ({"after": facts_of([self.after])} if self.after.frames else {})


def facts_of(founds: Sequence[Found]) -> dict[str, float]:
    """The facts about all presses of these pads."""
    within = np.array([error for found in founds for error in found.errors]) <= 2.0
    off_at_1n_m = [off for found in founds for off in found.off_at_1n_m]
    return {
        "frames": sum(found.frames for found in founds),
        "wrong": sum(found.wrong for found in founds),
        "worst_sd": max(found.worst for found in founds),
        "ok": sum(found.ok for found in founds) / sum(found.frames for found in founds),
        "false_contacts": sum(found.false_contacts for found in founds),
        "felt": sum(found.felt for found in founds) / sum(found.pressed for found in founds),
        "place_within_2_sd": float(within[:, :2].mean()),
        "force_within_2_sd": float(within[:, 2].mean()),
        "force_off_median": float(np.median(np.abs([share for found in founds for share in found.share]))),
        "force_sd_median": float(np.median([share for found in founds for share in found.claimed])),
        "place_off_at_1n_mm": 1e3 * float(np.median(off_at_1n_m)) if off_at_1n_m else float("nan"),
    }


def cells() -> list[tuple[Cell, float]]:
    return [
        (Cell(f"modulus × {modulus:g}, {thick:g} mm, finger {finger:g} mm", modulus, thick, finger), by)
        for thick, by, finger in PADS_MM
        for modulus in MODULI.get((thick, by, finger), (0.5, 1.0, 2.0))
    ]


def line(found: dict[str, float]) -> str:
    return (
        f"{found['wrong']:.0f} wrong of {found['frames']:.0f}, worst {found['worst_sd']:.1f} sd, within 2 sd place "
        f"{found['place_within_2_sd']:.1%} force {found['force_within_2_sd']:.1%}, force off by "
        f"{found['force_off_median']:.1%} of ± {found['force_sd_median']:.1%}, place by "
        f"{found['place_off_at_1n_mm']:.2f} mm at 1 N, ok {found['ok']:.1%}, felt {found['felt']:.1%}, false contacts "
        f"{found['false_contacts']:.0f}"
    )


def run(options: Namespace) -> None:
    rows = []
    for cell, by_mm in cells():
        if options.only and not cell.name.startswith(tuple(options.only)):
            continue
        row = Row(cell, by_mm)
        for seed in range(options.seed, options.seed + options.pads):
            row.build(seed, options.seconds)
        rows.append(row)
        print(f"{cell.name}, weight on {by_mm:g} mm: {np.round(row.stiffness, 3)} times as stiff", flush=True)
        for when in ("before", "after"):
            if when in row.facts:
                print(f"    {when:6} {line(row.facts[when])}")
        used = [f"{name}: {words}" for said in row.said for name, words in said.items() if words.startswith("right")]
        print(f"    refused {row.refused}; wrong weights that misled {row.misled}, that were used {used}")
    for when in ("before", "after"):
        print(f"all: {when:6} {line(facts_of([getattr(row, when) for row in rows]))}")
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode([row.facts for row in rows])) + b"\n")
