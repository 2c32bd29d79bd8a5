"""The effect of curvature on a most likely answer with large noise: its mean moves, and its bound grows.

The Cramér–Rao bound assumes a model that is straight over the noise, and an unbiased answer. Neither holds if the noise
is a third of the wanted quantity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.pad import Array

Model = Callable[[Array], Array]  # (K, U) unknowns → (K, M) measured values without noise


@dataclass(frozen=True)
class Curvature:
    """slope (K, M, U) and bend (K, M, U, U): first and second derivatives. weight (M, M): inverse covariance of the
    noise, without what other unknowns, free and straight, could explain."""

    slope: Array
    bend: Array
    weight: Array

    @property
    def information(self) -> Array:
        return _product(self.slope, self.weight, self.slope)

    @property
    def bias(self) -> Array:
        """(K, U) mean error of the most likely answer, to second order (Box, J. R. Stat. Soc. B 33, 1971)."""
        covariance = np.linalg.inv(self.information)
        bent = np.einsum("kmab,kab->km", self.bend, covariance)
        bias: Array = -0.5 * np.einsum("kab,kmb,mn,kn->ka", covariance, self.slope, self.weight, bent)
        return bias

    @property
    def bound(self) -> Array:
        """(K, U, U) least covariance of an unbiased answer by first and second derivatives of the likelihood
        (Bhattacharyya, Sankhyā 8, 1946); with the first ones alone it is the Cramér–Rao bound."""
        first = self.information
        rows, columns = np.triu_indices(self.slope.shape[2])
        bend = self.bend[:, :, rows, columns]
        mixed = _product(self.slope, self.weight, bend)
        second = _product(bend, self.weight, bend)
        for one, (a, b) in enumerate(zip(rows, columns, strict=True)):
            for other, (c, d) in enumerate(zip(rows, columns, strict=True)):
                second[:, one, other] += first[:, a, c] * first[:, b, d] + first[:, a, d] * first[:, b, c]
        bound: Array = np.linalg.inv(first - np.einsum("kam,kmn,kbn->kab", mixed, np.linalg.inv(second), mixed))
        return bound


def curvature(model: Model, at: Array, steps: Sequence[float], weight: Array) -> Curvature:
    """Slope and bend by differences of `model` around `at` (K, U), with these steps."""
    unknowns = at.shape[1]
    shifts = np.diag(np.asarray(steps, float))
    slope = np.stack([(model(at + one) - model(at - one)) / (2 * one.max()) for one in shifts], axis=-1)
    bend = np.empty((*slope.shape, unknowns))
    for a, one in enumerate(shifts):
        for b, other in enumerate(shifts[: a + 1]):
            cross = model(at + one + other) - model(at + one - other) - model(at - one + other)
            bend[..., a, b] = bend[..., b, a] = (cross + model(at - one - other)) / (4 * one.max() * other.max())
    return Curvature(slope, bend, weight)


def weight_with_free_ambient(noise: float, sensors: int) -> Array:
    """The weight (3 N, 3 N) of readings with white noise and one free ambient field."""
    ambient = np.tile(np.eye(3), (sensors, 1))
    weight: Array = (np.eye(3 * sensors) - ambient @ ambient.T / sensors) / noise**2
    return weight


def _product(left: Array, weight: Array, right: Array) -> Array:
    product: Array = np.einsum("kma,mn,knb->kab", left, weight, right)
    return product
