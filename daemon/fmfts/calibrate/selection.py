"""How large a network has to be: presses that were left out decide, in folds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fmfts.calibrate.fitting import fit_response
from fmfts.calibrate.likelihood import invert
from fmfts.calibrate.network import error_in_bounds, features, train_network, unit_of, weights
from fmfts.calibrate.regressors import GaussianProcess, RadialBasis
from fmfts.calibrate.samples import Samples, presses_within
from fmfts.calibrate.tracked import FrameSolver, Tracked
from fmfts.contact.response import Response
from fmfts.pad import Array

HIDDEN = (6, 8, 12, 16, 20, 24)
FOLDS = 3
PRESSES, STEPS, COPIES = 4000, 30, 8
RADIAL_CENTRES, FIRM_SHARE = 150, 0.1
# A larger network has to be this much better to be worth its time; or than the folds differ, where that is more.
WORTH_THE_TIME = 0.02


@dataclass(frozen=True, slots=True)
class Candidate:
    """score (folds,): rms error of left-out presses with the noise of one frame, in units of what that allows.
    parameters: numbers that it learns."""

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
) -> list[Candidate]:
    """Networks of each size, trained on so many presses, and what else could be used, on the same folds. sheared: of
    five outputs; else presses with shear are left aside."""
    if not sheared:
        rows = (press[:, 3:] == 0.0).all(axis=1)
        press, tracked = press[rows, :3], tracked.some(rows)
    fold = np.random.default_rng(0).permutation(len(press)) % FOLDS
    scores: dict[tuple[str, int | None], list[tuple[int, float]]] = {}
    for left_out in range(FOLDS):
        kept, out = fold != left_out, fold == left_out
        response = fit_response(
            press[kept], tracked.pose[kept, :5] - solver.rest_pose[:5], tracked.deviation[kept], roughness
        )
        judged = _noisy(response, solver, press[out], tracked, out)
        for name, hidden, parameters, found in _answers(response, solver, judged, sizes, presses):
            scores.setdefault((name, hidden), []).append((parameters, _score(found, judged)))
    return [
        Candidate(name, hidden, values[0][0], np.array([score for _, score in values]))
        for (name, hidden), values in scores.items()
    ]


def smallest_within_noise(candidates: list[Candidate]) -> Candidate:
    """The smallest network no worse than the best by more than the folds differ, or than is worth the time."""
    networks = [candidate for candidate in candidates if candidate.hidden is not None]
    best = min(networks, key=lambda candidate: candidate.mean)
    differ = float(best.score.std(ddof=1) / np.sqrt(len(best.score))) if len(best.score) > 1 else 0.0
    allowed = best.mean + max(WORTH_THE_TIME * best.mean, differ)
    return min((one for one in networks if one.mean <= allowed), key=lambda candidate: candidate.parameters)


def _noisy(response: Response, solver: FrameSolver, press: Array, tracked: Tracked, out: Array) -> Samples:
    """The left-out presses' own poses with noise; the bound from the response, for it alone knows the slope."""
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
    # What presses nothing has no place to learn: without the weight that tells so, it would ruin the rest.
    unit, firm = unit_of(training, solver.rest_pose), training.press[:, 2] > FIRM_SHARE * response.scale_n
    inputs, asked = (features(samples.pose, solver.rest_pose, unit) for samples in (training, judged))
    radial = RadialBasis(RADIAL_CENTRES).fit(inputs, training.press, weights(training, slice(0, 2))[:, 0])
    width = inputs.shape[1] + 1
    yield "RBF network", None, RADIAL_CENTRES * (width + judged.press.shape[1]), radial.predict(asked)
    rows = min(250, presses // 10)
    process = GaussianProcess(rows).fit(inputs[firm], training.press[firm])
    yield "Gaussian process", None, rows * width, process.predict(asked)
    found = invert(response, judged.pose[:, :5] - solver.rest_pose[:5], judged.covariance, across=3, steps=25)
    yield "table inversion", None, response.coefficient.size, found


def _score(found: Array, judged: Samples) -> float:
    return float(np.sqrt(np.mean(error_in_bounds(found - judged.press, judged.bound) ** 2)))
