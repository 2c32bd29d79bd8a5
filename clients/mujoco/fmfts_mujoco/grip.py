"""Lifts objects with `clients/python/examples/grip.py`, and says how hard it pressed, and what fell.

python -m fmfts_mujoco.grip --lifts 200 --seed 1
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path

import msgspec
import mujoco
import numpy as np
from fmfts.baseline import Baseline
from fmfts.config import PadConfig
from fmfts.config.file import load

from fmfts_mujoco.lifting import PERIOD_S, Lift, Lifting, pads_here
from fmfts_mujoco.motion import way_m
from fmfts_mujoco.objects import SHAPES, Object
from fmfts_mujoco.rivals import KINDS, controller, example
from fmfts_mujoco.scene import Scene
from fmfts_mujoco.setting_up import baselines

CONFIG = Path(__file__).with_name("models") / "grip.toml"
PADS_OF_A_SEED = 5  # pairs, each built anew
GOAL = 1.3


@dataclass(frozen=True, slots=True)
class Ended:
    """end: "held", "dropped" or "left": not lifted in time. share, most: force over least force while it was lifted and
    held, mean and largest; first: largest before the least force was known."""

    thing: Object
    end: str
    share: float
    most: float
    first: float
    slid_m: float
    slid_later_m: float

    def __str__(self) -> str:
        return (
            f"{self.thing.shape}, friction {self.thing.friction:.2f}, {self.thing.mass_kg:.3f} kg: {self.end}, "
            f"{self.share:.2f}, slid {1e3 * self.slid_m:.1f} mm, then {1e3 * self.slid_later_m:.1f} mm"
        )


@cache
def _pads(pair: int, as_built: bool, tolerance: str) -> tuple[list[PadConfig], dict[str, Baseline]]:
    """Two pads, and their baselines in the empty gripper. tolerance: "default" for hand-soldered chips."""
    configs = []
    for number, pad in enumerate(load(CONFIG)[0].pad):
        source = msgspec.structs.replace(pad.source, seed=2 * pair + number)
        pad = msgspec.structs.replace(pad, source=source)
        if tolerance == "default":
            pad = msgspec.structs.replace(
                pad,
                tolerance=msgspec.structs.replace(pad.tolerance, gain=0.05, sensor_rotation_deg=1.5, cross_axis=0.005),
            )
        configs.append(pad)
    model = Object.drawn(np.random.default_rng(0)).model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return configs, baselines(Scene(model, configs, as_built=as_built), data, turned=True)


def lift(
    number: int, seed: int, kind: str, shape: str | None, as_built: bool, tolerance: str, motions: tuple[Path, ...] = ()
) -> Ended:
    """One. The same seed and number draw the same object, pads and noise for each controller. motions: recorded ones,
    which the lifts follow in turns."""
    thing = Object.drawn(np.random.default_rng([seed, number]), shape)
    configs, recorded = _pads(100 * seed + number % PADS_OF_A_SEED, as_built, tolerance)
    pads = pads_here(configs, recorded, number, as_built=as_built)
    motion_m = way_m(motions[number % len(motions)], PERIOD_S) if motions else None
    return ended(Lifting(thing, pads, motion_m).run(controller(kind), example().usable))


def ended(lifted: Lift) -> Ended:
    shares, first = lifted.shares("lift", "hold", "move"), lifted.shares("air")
    end = "held" if lifted.held else "dropped" if lifted.dropped else "left"
    nothing = float("nan")
    return Ended(
        lifted.thing,
        end,
        float(shares.mean()) if len(shares) else nothing,
        float(shares.max()) if len(shares) else nothing,
        float(first.max()) if len(first) else nothing,
        lifted.slid_m("close", "load", "air"),
        lifted.slid_m("lift", "hold", "move"),
    )


def line(name: str, ends: list[Ended]) -> str:
    """A row of the table."""
    kept = [each for each in ends if each.end == "held"]
    dropped, left = (sum(each.end == end for each in ends) for end in ("dropped", "left"))
    row = f"{name:24} {len(ends)} lifts: {dropped} dropped, {left} not lifted in time"
    if not kept:
        return row
    share, most, first = (np.array([getattr(each, key) for each in kept]) for key in ("share", "most", "first"))
    slid, later = (1e3 * np.array([getattr(each, key) for each in kept]) for key in ("slid_m", "slid_later_m"))
    low, middle, high = np.percentile(share, (5, 50, 95))
    return (
        f"{row}; held with at most {GOAL} × the least force: {100 * (share <= GOAL).sum() / len(ends):.1f} %\n"
        f"    force / least: {middle:.2f} ({low:.2f} to {high:.2f}, largest {share.max():.2f}); its peaks "
        f"{np.median(most):.2f}, largest {most.max():.2f}; before it was known {np.nanmedian(first):.2f}\n"
        f"    slid (mm): {np.median(slid):.1f} until the least force was known, {np.percentile(slid, 95):.1f} of 95 %; "
        f"later {np.median(later):.1f}, {np.percentile(later, 95):.1f}, largest {later.max():.1f}"
    )


def by_friction(ends: list[Ended]) -> str:
    """Where it misses."""
    rows = []
    for low, high in ((0.2, 0.3), (0.3, 0.4), (0.4, 0.6), (0.6, 0.9), (0.9, 1.2)):
        own = [each for each in ends if low <= each.thing.friction < high]
        good = sum(each.end == "held" and each.share <= GOAL for each in own)
        fell = sum(each.end == "dropped" for each in own)
        rows.append(f"{low:g} to {high:g}: {good} of {len(own)}, {fell} dropped")
    return "    good, by friction: " + "; ".join(rows)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--lifts", type=int, default=200)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--controllers", nargs="+", choices=KINDS, default=KINDS)
    options.add_argument("--shape", choices=(*SHAPES, "sharp", "rod", "wall"), help="of all objects")
    options.add_argument("--as-built", action="store_true", help="pads within their tolerances, and other fingertips")
    options.add_argument("--tolerance", choices=("tested", "default"), default="tested", help="of the chips")
    options.add_argument("--motions", type=Path, nargs="+", metavar="CSV", help="then move up as a recorded arm moved")
    options.add_argument("--processes", type=int, default=2)
    options.add_argument("--each", action="store_true", help="a line for each lift")
    chosen = options.parse_args()
    with ProcessPoolExecutor(chosen.processes, get_context("spawn")) as processes:
        for kind in chosen.controllers:
            one = partial(
                lift,
                seed=chosen.seed,
                kind=kind,
                shape=chosen.shape,
                as_built=chosen.as_built,
                tolerance=chosen.tolerance,
                motions=tuple(chosen.motions or ()),
            )
            ends: list[Ended] = []
            for each in processes.map(one, range(chosen.lifts)):
                if chosen.each:
                    print(f"{len(ends)} {each}", flush=True)
                ends.append(each)
            print(line(kind, ends))
            print(by_friction(ends), flush=True)


if __name__ == "__main__":
    main()
