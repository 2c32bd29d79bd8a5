"""Draws labelled poses for training and tests from a pad's response, with the noise of single frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fmfts.contact.response import Response
from fmfts.pad import Array
from fmfts_calibrate.bounds import bound_of
from fmfts_calibrate.tracked import FrameSolver, upright

# Largest force of training, relative to the calibrated one: the estimate must still rise in the range of "over range".
BEYOND = 1.3
UNLOADED = 0.05  # share of samples without force, from which the model learns the rest pose


@dataclass(frozen=True, slots=True)
class Samples:
    """press (K, 2 + L): in mm and N. pose (K, 6): as the model gets it. covariance (K, 5, 5): of the pose, by the noise
    of one frame. bound (K, 2 + L): smallest deviation of an unbiased estimate of the press (Cramér–Rao)."""

    press: Array
    pose: Array
    covariance: Array
    bound: Array

    def __len__(self) -> int:
        return len(self.press)

    @classmethod
    def expected(cls, response: Response, solver: FrameSolver, press: Array) -> Samples:
        """Noise-free samples of presses (K, 2 + L)."""
        change, slope = response.change_and_slope(press)
        pose = np.column_stack([solver.rest_pose[:5] + change, np.zeros(len(press))])
        tracked = solver.at(upright(pose))
        return cls(press, tracked.pose, tracked.covariance, bound_of(slope, tracked.covariance))

    def noisy(self, copies: int, random: np.random.Generator) -> Samples:
        """Each press `copies` times, with noise drawn from the covariance added to its pose."""
        press, pose, covariance, bound = (
            np.repeat(values, copies, axis=0) for values in (self.press, self.pose, self.covariance, self.bound)
        )
        pose[:, :5] += np.einsum("kij,kj->ki", np.linalg.cholesky(covariance), random.standard_normal((len(pose), 5)))
        return type(self)(press, upright(pose), covariance, bound)

    def joined(self, other: Samples) -> Samples:
        return Samples(
            np.concatenate([self.press, other.press]),
            np.concatenate([self.pose, other.pose]),
            np.concatenate([self.covariance, other.covariance]),
            np.concatenate([self.bound, other.bound]),
        )


def presses_in_bins(response: Response, ends_n: Sequence[float], count: int, random: np.random.Generator) -> Array:
    """(bins · count, 2 + L): `count` presses in each bin of force; the share UNLOADED of the first bin is at rest."""
    press = presses_within(response, len(ends_n) * count, random, beyond=1.0)
    force = np.concatenate([random.uniform(*ends, count) for ends in pairwise([0.0, *ends_n])])
    force[: int(UNLOADED * count)] = 0.0
    press[:, 3:] *= (force / np.where(press[:, 2] > 0.0, press[:, 2], 1.0))[:, None]
    press[:, 2] = force
    return press


def presses_within(response: Response, count: int, random: np.random.Generator, beyond: float = BEYOND) -> Array:
    """(count, 2 + L) random presses, uniform over the response's table, from no force to `beyond` times its largest.

    Shear is uniform over the calibrated disc, whose radius is proportional to the force.
    """
    place = random.uniform(response.first_mm, response.last_mm, (count, 2))
    force = random.uniform(0.0, beyond * response.scale_n, count)
    force[: int(UNLOADED * count)] = 0.0
    if response.loads == 1:
        return np.column_stack([place, force])
    angle, share = random.uniform(0.0, 2.0 * np.pi, count), np.sqrt(random.uniform(0.0, 1.0, count))
    shear = response.friction * share * force
    return np.column_stack([place, force, shear * np.cos(angle), shear * np.sin(angle)])
