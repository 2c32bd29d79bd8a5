"""Can a cold start give a wrong pose that is not flagged?"""

from __future__ import annotations

from argparse import Namespace
from time import process_time

import numpy as np

from fmfts.common.chi2 import quantile
from fmfts.pose import Problem, State, Status, acquire, parts_of
from fmfts.pose.acquisition import starts_in_box
from fmfts.pose.kernel import predict
from fmfts.pose.problem import VALUE, magnet_rows, measurement_rows
from fmfts.sensor.chips import NOISE_T
from fmfts_lab.bench.workspace import MODELS, anywhere, standard_pad

# The share of right answers that count as misfits.
FALSE_ALARM = 1e-6
# An error counts as rare, or wrong, if noise alone makes one as large in this share of right answers.
RARE, WRONG = 1e-6, 1e-9
EARTH_T = 5e-5
# Half the box of starts about the rest pose: beyond the workspace on every side.
SEARCHED_M = np.array([5e-3, 5e-3, 6e-3])


def run(options: Namespace) -> None:
    print(f"{options.draws} cold starts each, anywhere in a workspace twice as wide, any axis, start unrelated to it")
    print("flagged: no convergence, a misfit, a second pose that fits as well, or a bent valley")
    print(f"wrong: an error as one right answer in {1 / WRONG:.0e} has by its noise; rare: in {1 / RARE:.0e}\n")
    print("sensors unknowns |   right   rare  wrong  flagged: unsolved misfit  rival   bent | ms each")
    for sensors in options.sensors:
        for unknowns in options.unknowns:
            _count(options.draws, sensors, unknowns, np.random.default_rng(options.seed))


def _count(draws: int, sensors: int, unknowns: int, random: np.random.Generator) -> None:
    pad, free = standard_pad(), MODELS[unknowns]
    poses = anywhere(draws, random, EARTH_T if unknowns == 8 else 0.0)
    starts = anywhere(draws, random, 0.0).position_m
    rows = measurement_rows(np.zeros((4, 3)), pad.sensors, NOISE_T)[: 3 * sensors]
    magnets = magnet_rows(pad.magnet, octupole=True)
    around = starts_in_box(pad.rest_position_m, SEARCHED_M)
    limit = quantile(FALSE_ALARM, len(rows) - unknowns)
    rare, wrong = quantile(RARE, unknowns), quantile(WRONG, unknowns)
    counts = dict.fromkeys(("right", "rare", "wrong", "unsolved", "misfit", "rival", "bent"), 0)
    begun = process_time()
    for index in range(draws):
        truth = poses.state(index)
        rows[:, VALUE] = predict(rows, magnets, truth)[0] + random.normal(0.0, NOISE_T, len(rows))
        problem = Problem(rows, magnets, parts_of(free=free), State.at_rest(pad))
        found = acquire(problem, np.concatenate([starts[index : index + 1], around]), limit)
        best = found.best
        if best.status is not Status.CONVERGED:
            counts["unsolved"] += 1
        elif best.chi2 > limit:
            counts["misfit"] += 1
        elif found.rivals:
            counts["rival"] += 1
        elif found.bent:
            counts["bent"] += 1
        else:
            step = truth.step_from(best.state)[free]
            away = step @ np.linalg.solve(best.covariance[np.ix_(free, free)], step)
            counts["right" if away < rare else "rare" if away < wrong else "wrong"] += 1
    each = (process_time() - begun) / draws * 1e3
    believed = f"{counts['right']:7d} {counts['rare']:6d} {counts['wrong']:6d}"
    flagged = f"{counts['unsolved']:6d} {counts['misfit']:6d} {counts['rival']:6d} {counts['bent']:6d}"
    print(f"{sensors:7d} {unknowns:8d} | {believed}           {flagged} | {each:.2f}", flush=True)
