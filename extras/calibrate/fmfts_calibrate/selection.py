"""Selects the size of the network by its error on left-out presses, in folds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.contact.response import Response
from fmfts.pad import Array
from fmfts_calibrate.fitting import fit_response
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.network import error_in_bounds, train_network
from fmfts_calibrate.samples import Samples, presses_within
from fmfts_calibrate.sweep import Workers
from fmfts_calibrate.tracked import FrameSolver, Tracked

HIDDEN = (6, 8, 12, 16, 20, 24)
FOLDS = 3
PRESSES, STEPS, COPIES = 4000, 30, 8
# A larger network must be better by this share, or by the standard error over the folds, where that is larger.
WORTH_THE_TIME = 0.02


@dataclass(frozen=True, slots=True)
class Candidate:
    """score (folds,): rms of `error_in_bounds` for left-out presses with the noise of one frame. parameters: number of
    weights."""

    name: str
    hidden: int | None
    parameters: int
    score: Array

    @property
    def mean(self) -> float:
        return float(self.score.mean())

    def facts(self) -> dict[str, float | str]:
        return {"name": self.name, "parameters": self.parameters, "error_in_bounds": round(self.mean, 4)}


def compare(
    solver: FrameSolver,
    press: Array,
    tracked: Tracked,
    roughness: float,
    sizes: tuple[int, ...] = HIDDEN,
    presses: int = PRESSES,
    sheared: bool = False,
    workers: Workers | None = None,
    done: Callable[[int], None] = lambda _: None,
) -> list[Candidate]:
    """Compare networks of each size, trained on `presses` presses, and the table's inversion, on the same folds.

    sheared: with five outputs; otherwise presses with shear are left out. workers: where each fold is computed; None:
    here. done: takes the number of folds that are computed.
    """
    if not sheared:
        rows = (press[:, 3:] == 0.0).all(axis=1)
        press, tracked = press[rows, :3], tracked.some(rows)
    fold = np.random.default_rng(0).permutation(len(press)) % FOLDS
    scores: dict[tuple[str, int | None], list[tuple[int, float]]] = {}
    pieces = [(solver, press, tracked, roughness, fold == left_out, sizes, presses) for left_out in range(FOLDS)]
    finished = count(1)
    for scored in (workers or Workers()).map(_fold, pieces, lambda *_: done(next(finished))):
        for name, hidden, parameters, score in scored:
            scores.setdefault((name, hidden), []).append((parameters, score))
    return [
        Candidate(name, hidden, values[0][0], np.array([score for _, score in values]))
        for (name, hidden), values in scores.items()
    ]


def _fold(
    solver: FrameSolver,
    press: Array,
    tracked: Tracked,
    roughness: float,
    out: Array,
    sizes: tuple[int, ...],
    presses: int,
) -> list[tuple[str, int | None, int, float]]:
    """Name, layer size, parameters and score of each candidate for the presses `out`, fitted to the others."""
    with threadpool_limits(1):  # the same bits in any process
        kept = np.logical_not(out)
        response = fit_response(
            press[kept], tracked.pose[kept, :5] - solver.rest_pose[:5], tracked.deviation[kept], roughness
        )
        judged = _noisy(response, solver, press[out], tracked, out)
        return [
            (name, hidden, parameters, _score(found, judged))
            for name, hidden, parameters, found in _answers(response, solver, judged, sizes, presses)
        ]


def smallest_within_noise(candidates: list[Candidate]) -> Candidate:
    """The smallest network that is worse than the best by at most WORTH_THE_TIME, or the standard error over folds."""
    networks = [candidate for candidate in candidates if candidate.hidden is not None]
    best = min(networks, key=lambda candidate: candidate.mean)
    standard_error = float(best.score.std(ddof=1) / np.sqrt(len(best.score))) if len(best.score) > 1 else 0.0
    allowed = best.mean + max(WORTH_THE_TIME * best.mean, standard_error)
    return min((one for one in networks if one.mean <= allowed), key=lambda candidate: candidate.parameters)


def _noisy(response: Response, solver: FrameSolver, press: Array, tracked: Tracked, out: Array) -> Samples:
    """The measured poses of left-out presses, with noise added; the bound is from the response's slope."""
    expected = Samples.expected(response, solver, press)
    measured = Samples(press, tracked.pose[out], tracked.covariance[out], expected.bound)
    return measured.noisy(COPIES, np.random.default_rng(1))


def _answers(
    response: Response, solver: FrameSolver, judged: Samples, sizes: tuple[int, ...], presses: int
) -> Iterator[tuple[str, int | None, int, Array]]:
    """Name, layer size, parameters and answers of each candidate."""
    random = np.random.default_rng(2)
    clean = Samples.expected(response, solver, presses_within(response, presses, random))
    training = clean.noisy(1, random)
    for hidden in sizes:
        network = train_network(training, solver.rest_pose, hidden, STEPS)
        yield f"two layers of {hidden}", hidden, network.layers.parameters, network(judged.pose)
    found = invert(response, judged.pose[:, :5] - solver.rest_pose[:5], judged.covariance, across=3, steps=25)
    yield "table inversion", None, response.coefficient.size, found


def _score(found: Array, judged: Samples) -> float:
    return float(np.sqrt(np.mean(error_in_bounds(found - judged.press, judged.bound) ** 2)))
