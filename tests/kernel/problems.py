"""Problems for the pose solvers: one on the standard pad; random ones of any geometry, state, and role for any part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.pad import Pad
from fmfts.pose import STOP_CONVERGED, Motion, Part, Prior, Problem, State, parts_of
from fmfts.pose.kernel import predict
from fmfts.pose.problem import (
    AGE,
    DIRECTION,
    MEASUREMENT,
    NOISE,
    PLACE,
    PROPORTIONAL,
    VALUE,
    magnet_rows,
    measurement_rows,
)
from fmfts.pose.state import AXIS, NEIGHBOUR_SIZE, SIZE, Neighbour

# Deviations of a prior about as wide as a frame's motion: m, rad, 1, T, T/m; then a neighbour's.
PRIOR_DEVIATION = np.array(
    [1e-4] * 3 + [0.02] * 2 + [0.02] + [3e-6] * 3 + [3e-5] * 5 + [3e-4] * 3 + [0.05] * 2 + [0.05]
)
NOISE_T = 2e-7
TRUTH = State(np.array([0.5e-3, 0.3e-3, 10.5e-3]), np.array([0.0, 0.6, 0.8]), 0.02, np.array([1e-5, -2e-5, 5e-6]))


def problem_at(pad: Pad, truth: State = TRUTH, **changes: object) -> Problem:
    """Noise-free measurements of `truth` by the standard pad, all of pose and ambient free, started there."""
    rows = measurement_rows(np.zeros((4, 3)), pad.sensors, NOISE_T)
    magnets = magnet_rows(pad.magnet)
    rows[:, VALUE], _ = predict(rows, magnets, truth)
    whole = Problem(rows, magnets, parts_of(free=[0, 1, 2, 3, 4, 6, 7, 8]), truth, stop_chi2=STOP_CONVERGED)
    return replace(whole, **changes)  # type: ignore[arg-type]


def _unit(random: np.random.Generator) -> np.ndarray:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _geometry(random: np.random.Generator, sensors: int) -> np.ndarray:
    """Three scalars at each of `sensors` places in a box of 24 mm under the magnet; directions are random."""
    rows = np.zeros((3 * sensors, MEASUREMENT))
    rows[:, PLACE] = np.repeat(random.uniform([-12e-3, -12e-3, -4e-3], [12e-3, 12e-3, 2e-3], (sensors, 3)), 3, axis=0)
    rows[:, DIRECTION] = np.linalg.qr(random.normal(size=(sensors, 3, 3)))[0].reshape(-1, 3)
    if random.random() < 0.3:  # scalar sensors: no two directions have to be perpendicular
        rows[:, DIRECTION] = np.array([_unit(random) for _ in rows])
    rows[:, NOISE] = NOISE_T * random.uniform(0.5, 2.0, len(rows))
    rows[:, PROPORTIONAL] = random.choice([0.0, 0.01])
    rows[:, AGE] = np.repeat(random.uniform(0.0, 4.5e-3, sensors), 3)
    return rows


def _state(random: np.random.Generator, neighbours: int) -> State:
    others = tuple(
        Neighbour(_unit(random) * random.uniform(30e-3, 60e-3) + [0, 0, 12e-3], _unit(random), random.normal() * 0.1)
        for _ in range(neighbours)
    )
    position = random.uniform([-2e-3, -2e-3, 9e-3], [2e-3, 2e-3, 14e-3])
    ambient, gradient = random.normal(size=3) * 2e-5, random.normal(size=5) * 1e-5
    return State(position, _unit(random), random.normal() * 0.1, ambient, gradient, others)


def _parts(random: np.random.Generator, neighbours: int) -> np.ndarray:
    """Any role for any part; a gradient or a neighbour always has a prior."""
    parts = np.zeros(SIZE + NEIGHBOUR_SIZE * neighbours, dtype=np.uint8)
    any_part = [Part.FREE, Part.PRIOR, Part.CONSIDERED, Part.FIXED]
    parts[:3] = random.choice([Part.FREE, Part.PRIOR], 3)
    for first in (0, *range(SIZE, len(parts), NEIGHBOUR_SIZE)):
        bound = any_part[1:] if first else any_part
        parts[first:][AXIS] = random.choice(bound)
        parts[first + 5] = random.choice(bound)
        if first:
            parts[first : first + 3] = random.choice(bound, 3)
    parts[6:9] = random.choice(any_part, 3)
    parts[9:14] = random.choice(any_part[1:], 5)
    return parts


def _prior(random: np.random.Generator, mean: State) -> Prior:
    count = mean.columns
    deviation = np.concatenate([PRIOR_DEVIATION[:SIZE], np.tile(PRIOR_DEVIATION[SIZE:], len(mean.neighbours))])
    mixed = np.eye(count) + 0.3 * random.normal(size=(count, count)) / np.sqrt(count)
    return Prior(mean, (mixed @ mixed.T) * deviation[:, None] * deviation)


def random_problem(seed: int, sensors: int, neighbours: int, moving: bool) -> Problem:
    """A problem with a solution near its start, measured by `sensors` triples, some of them with a row missing."""
    random = np.random.default_rng(seed)
    truth = _state(random, neighbours)
    rows = _geometry(random, sensors)
    strength = random.uniform(3e-10, 1e-9, 1 + neighbours)
    octupole = random.choice([0.0, 2.5e-7], 1 + neighbours)
    magnets = np.stack([strength, octupole], axis=1)
    parts = _parts(random, neighbours)
    prior = _prior(random, truth)
    scale = np.sqrt(np.diagonal(prior.covariance))
    predicted, _ = predict(rows, magnets, truth)
    rows[:, VALUE] = predicted + random.normal(size=len(rows)) * rows[:, NOISE]
    rows[random.random(len(rows)) < 0.05, VALUE] = np.nan
    rows[random.random(len(rows)) < 0.05, NOISE] = np.inf
    wrong = np.select([parts == Part.FIXED, parts == Part.CONSIDERED], [0.0, 0.1], 1.0)
    step = wrong * random.normal(size=truth.columns) * scale
    motion = Motion(random.normal(size=truth.columns) * scale, scale**2 * 10.0) if moving else None
    start = truth.stepped(step)
    prior = replace(prior, mean=start.stepped(0.3 * step))
    # With few or badly placed sensors the last digits converge slowly.
    return Problem(rows, magnets, parts, start, prior, motion, STOP_CONVERGED, max_iterations=200)
