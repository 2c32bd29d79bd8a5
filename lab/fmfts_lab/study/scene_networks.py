"""Bias and noise of contact networks of every size, on the presses of a scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.pad import Array
from fmfts_calibrate.network import error_in_bounds, train_network
from fmfts_calibrate.samples import Samples, presses_within
from fmfts_calibrate.selection import Candidate, smallest_within_noise
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.calibration.simulated import rest_field_of
from fmfts_lab.scene import Surroundings
from fmfts_lab.study.harness import Row

SIZES = (4, 6, 8, 12, 16, 24)
JUDGED = 4000


@dataclass(frozen=True, slots=True)
class Networks:
    """Trains contact networks on single frames of the scene, and judges them by such frames."""

    solver: FrameSolver
    training: Samples
    judged: Samples
    steps: int

    @classmethod
    def of(cls, surroundings: Surroundings, quick: bool) -> Networks:
        pad, response = surroundings.config.pad(), surroundings.response
        solver = FrameSolver(
            pad, rest_field_of(pad), "drifting" if surroundings.drifts else "constant", surroundings.noise_t
        )
        random = np.random.default_rng(1)
        clean = Samples.expected(response, solver, presses_within(response, 800 if quick else 4000, random))
        judged = Samples.expected(response, solver, presses_within(response, JUDGED, random, beyond=1.0))
        return cls(solver, clean.noisy(1, random), judged, 12 if quick else 40)

    def rows(self, hidden: int) -> Iterator[Row]:
        """Errors without and with noise, each divided by what a frame allows or by the smallest one that matters."""
        network = train_network(self.training, self.solver.rest_pose, hidden, self.steps)
        noisy = self.judged.noisy(1, np.random.default_rng(2))
        bias = _rms(error_in_bounds(network(self.judged.pose) - self.judged.press, self.judged.bound))
        score = _rms(error_in_bounds(network(noisy.pose) - noisy.press, noisy.bound))
        yield {
            "kind": "network",
            "hidden": hidden,
            "parameters": network.layers.parameters,
            "bias_in_bounds": bias,
            "noise_in_bounds": float(np.sqrt(max(score**2 - bias**2, 0.0))),
            "score": score,
        }


def smallest_network(rows: Sequence[Row]) -> str:
    """The smallest network within 2 % of the best one, and the gain of the next larger one."""
    candidates = [
        Candidate(str(row["hidden"]), int(row["hidden"]), int(row["parameters"]), np.array([row["score"]], dtype=float))  # type: ignore[arg-type]
        for row in rows
        if row["kind"] == "network"
    ]
    best = smallest_within_noise(candidates)
    larger = [one for one in candidates if one.parameters > best.parameters]
    gain = f"; two layers of {larger[0].name} would gain {1.0 - larger[0].mean / best.mean:.1%}" if larger else ""
    return f"recommended network: two layers of {best.name}, {best.parameters} parameters{gain}"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
