"""How often an exact pose gives a force that is wrong by more than five of its deviations: pads as in `as-built
--counted stated`, without noise or a baseline's errors, so that 20,000 of them take a minute.

Few pads in 10,000 are that far off, and `as-built` has some hundred.
"""

from __future__ import annotations

from argparse import Namespace
from itertools import pairwise

import numpy as np

from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.as_built import WITHIN_DEVIATIONS, pad_config
from fmfts_lab.bench.built_world import Defects
from fmfts_lab.bench.silicone import RealPad
from fmfts_lab.bench.stated_world import StatedMechanics
from fmfts_lab.bench.truth import WRONG_DEVIATIONS

PRESSES = 12  # of each pad: within 10 mm, 0.2 to 2 N, as in `as-built`
POSE_SD = np.array([1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3])  # m, and components of the axis
RINGS_M = (0.0, 4e-3, 8e-3, 15e-3)


def errors_of(pads: int, random: np.random.Generator) -> tuple[Array, Array]:
    """(P, PRESSES, 3) errors of x, y and the force, in their deviations, NaN where the pad is over range; and how far
    from the middle each press is, (P, PRESSES) m."""
    config = pad_config(Defects(1.0, 0.005, turning=False, stated=True), False, "stated")
    model, pad, exact = load_contact_model(config), config.pad(), RealPad(config).built.mechanics
    errors, away_m = np.empty((pads, PRESSES, 3)), np.empty((pads, PRESSES))
    for one in range(pads):
        mechanics = StatedMechanics.drawn(exact, random)
        press = np.column_stack([random.uniform(-1e-2, 1e-2, (PRESSES, 2)), random.uniform(0.2, 2.0, PRESSES)])
        away_m[one] = np.hypot(press[:, 0], press[:, 1])
        for number, change in enumerate(mechanics.response(*press.T)):
            axis = np.append(change[3:], np.sqrt(1.0 - change[3:] @ change[3:]))
            found = model.estimate(pad.rest_position_m + change[:3], axis, np.diag(POSE_SD**2))
            off = (found.values - press[number]) / found.deviations
            errors[one, number] = np.nan if found.over_range else off
    return errors, away_m


def run(options: Namespace) -> None:
    errors, away_m = errors_of(options.pads, np.random.default_rng(options.seed))
    off = np.abs(errors)
    wrong = np.nan_to_num(off) > WRONG_DEVIATIONS
    print(f"{options.pads} pads: {wrong[..., 2].any(axis=1).sum()} with a wrong force, ", end="")
    print(f"{wrong[..., :2].any(axis=(1, 2)).sum()} with a wrong place")
    for inner_m, outer_m in pairwise(RINGS_M):
        there = (away_m >= inner_m) & (away_m < outer_m) & ~np.isnan(off[..., 2])
        within = np.mean(off[there] <= WITHIN_DEVIATIONS, axis=0)
        root = np.sqrt(np.mean(np.square(off[there]), axis=0))
        print(
            f"{inner_m * 1e3:2.0f} to {outer_m * 1e3:2.0f} mm: within 2 sd places {within[:2].mean():.1%}, "
            f"forces {within[2]:.1%}; root mean square {root[:2].mean():.2f}, {root[2]:.2f} sd; "
            f"{wrong[there][:, 2].sum()} wrong forces of {there.sum()}"
        )
