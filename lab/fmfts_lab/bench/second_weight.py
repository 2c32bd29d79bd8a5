"""Does a second weight, away from the middle, tell how thick a pad is? Its reading, over that of one in the middle.

Thickness changes the ratio of both readings, and so does the mounting of the chips. The spread of the ratio over built
pads, divided by its change with the thickness, is the deviation to which a second weight would tell the thickness.
"""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.cast_pads import CastPad, ramps
from fmfts_lab.bench.few_presses import PROBE_MM
from fmfts_lab.bench.silicone import messages_of
from fmfts_lab.bench.structure import Cell
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.weigh import Bench
from fmfts_simulation.finger import steady_finger

THICKNESSES_MM = (3.6, 4.0, 4.4)
WEIGHT_N, SETTLED_S, SECONDS = 0.981, 0.5, 1.5
IMAGES = 8  # each solved place has this many presses, and each pad draws one of them


def readings(thickness_mm: float, seed: int) -> list[float]:
    """The reading of the weight at each solved place, the innermost first; NaN where none is read."""
    bench = Bench(Cell("pad", thickness_mm=thickness_mm), PROBE_MM, seed)
    pipeline = without_baseline(bench.config, load_contact_model(bench.config))
    solved, random, found = ramps(CastPad(thickness_mm, PROBE_MM), sheared=False), np.random.default_rng(seed), []
    for first in range(0, len(solved), IMAGES):
        pipeline.use(bench.baseline)
        source = bench.pad(Cell("pad", thickness_mm=thickness_mm))
        source.finger = steady_finger(*solved[first + int(random.integers(IMAGES))].place_m, WEIGHT_N)
        messages = messages_of(pipeline, source.recorded(SECONDS))
        begun_ns = messages[0].t_sample_ns + SETTLED_S * 1e9
        forces = [one.force_n for one in messages if one.t_sample_ns > begun_ns and one.force_n is not None]
        found.append(float(np.mean(forces)) if forces else np.nan)
    return found


def run(options: Namespace) -> None:
    seeds = range(options.seed, options.seed + options.pads)
    read = np.array([[readings(thickness, seed) for seed in seeds] for thickness in THICKNESSES_MM])
    ratio = np.log(read[:, :, 1:] / read[:, :, :1])  # (thickness, seed, place)
    places = [
        np.hypot(*one.place_m) * 1e3 for one in ramps(CastPad(THICKNESSES_MM[0], PROBE_MM), sheared=False)[::IMAGES]
    ]
    across_mm = THICKNESSES_MM[-1] - THICKNESSES_MM[0]
    for number, radius_mm in enumerate(places[1:]):
        slope = float((ratio[-1, :, number] - ratio[0, :, number]).mean()) / across_mm
        spread = float(np.sqrt(np.mean(np.var(ratio[:, :, number], axis=1, ddof=1))))
        print(
            f"{radius_mm:4.1f} mm from the middle: the ratio changes by {slope:+.1%} for each mm of thickness, and is "
            f"spread by {spread:.1%} over {len(seeds)} pads: it tells the thickness to {spread / abs(slope):.2f} mm"
        )
