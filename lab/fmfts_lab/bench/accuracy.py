"""Compares the errors of the solver with the Cramér–Rao bound, by Monte Carlo."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from fmfts.pose import STOP_CHI2, Batch
from fmfts.pose.kernel import STATUS
from fmfts.pose.state import AMBIENT, AXIS, LOG_MOMENT, POSITION, SIZE, turn_between
from fmfts_lab.bench.workspace import MODELS, Array, Poses, batch_of, in_workspace, readings, standard_pad

MAX_ITERATIONS = 50


def run(options: Namespace) -> None:
    pad, random = standard_pad(), np.random.default_rng(options.seed)
    poses = in_workspace(options.draws, random)
    rows = readings(poses, pad, random)
    print(f"{options.draws} poses, exact cylinder fields, 2 mG of noise, each solved from rest")
    print("RMSE over the bound; NEES over its expectation, with the 95 % band for an honest covariance\n")
    print(
        "unknowns octupole |      x      y      z   tilt 1 tilt 2 | all that is free |  NEES   band          | unsolved"
    )
    for unknowns in MODELS:
        for octupole in (True, False):
            rest = np.tile(poses.states()[0], (options.draws, 1))
            rest[:, :7] = [*pad.rest_position_m, *pad.rest_axis, 0.0]
            batch = batch_of(rows, pad, unknowns, octupole, rest)
            batch.solve(STOP_CHI2, MAX_ITERATIONS)
            # Without iterations the solver returns the covariance at the true pose, which is the bound.
            bound = batch_of(rows, pad, unknowns, True, poses.states())
            bound.solve(STOP_CHI2, 0)
            _report(unknowns, octupole, batch, bound, poses)


def _report(unknowns: int, octupole: bool, batch: Batch, bound: Batch, poses: Poses) -> None:
    free, count = MODELS[unknowns], len(batch.summary)
    solved = batch.summary[:, STATUS] == 0
    steps = _errors(batch, poses)[solved][:, free]
    variance = np.diagonal(bound.covariance, axis1=1, axis2=2)[solved][:, free]
    ratio = np.sqrt((steps**2).mean(axis=0) / variance.mean(axis=0))
    # Each error is in the deviation of its own pose, so that all poses have the same weight.
    whole = np.sqrt((steps**2 / variance).mean())
    information = np.linalg.inv(batch.covariance[solved][:, free[:, None], free])
    nees = np.einsum("ki,kij,kj->k", steps, information, steps).mean() / len(free)
    half = 1.96 * np.sqrt(2.0 / (len(free) * count))
    verdict = "in" if abs(nees - 1.0) < half else "out"
    shown = "  ".join(f"{value:5.3f}" for value in ratio[:5])
    print(
        f"{unknowns:8d} {'on' if octupole else 'off':>8} |  {shown} | {whole:16.3f} | {nees:6.3f} "
        f"{1 - half:.3f}–{1 + half:.3f} {verdict:>3} | {int((~solved).sum())}"
    )


def _errors(batch: Batch, poses: Poses) -> Array:
    """(K, 14) step from each estimate to the truth, in the estimate's tangent plane, like its covariance."""
    truth, steps = poses.states(), np.zeros((len(batch.state), SIZE))
    steps[:, POSITION] = truth[:, 0:3] - batch.state[:, 0:3]
    steps[:, LOG_MOMENT] = truth[:, 6] - batch.state[:, 6]
    steps[:, AMBIENT] = truth[:, 7:10] - batch.state[:, 7:10]
    for step, estimate, true in zip(steps, batch.state, truth, strict=True):
        step[AXIS] = turn_between(estimate[3:6], true[3:6])
    return steps
