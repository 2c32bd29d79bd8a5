"""Regressors with one interface, for comparisons: fit(inputs, target, weight) → itself, predict(inputs) → target.

Inputs (K, d) may be poses or fields in any unit: each column is scaled to ±1, like MATLAB's `mapminmax`. The network
that ships is in fmfts_calibrate.network: it is trained with the pose's noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array
from fmfts_calibrate.levenberg import Layers, train


class Regressor(Protocol):
    """fit: inputs (K, d), target (K, m), weight (K,) of each row's squared error; None: equal weights."""

    def fit(self, inputs: Array, target: Array, weight: Array | None = None) -> Regressor: ...

    def predict(self, inputs: Array) -> Array: ...


@dataclass(frozen=True, slots=True)
class Span:
    """Scales each column's range to ±1; a constant column to 0."""

    middle: Array
    half: Array

    @classmethod
    def of(cls, values: Array) -> Span:
        low, high = values.min(axis=0), values.max(axis=0)
        return cls((low + high) / 2.0, np.where(high > low, (high - low) / 2.0, 1.0))

    def shrunk(self, values: Array) -> Array:
        shrunk: Array = (values - self.middle) / self.half
        return shrunk

    def restored(self, values: Array) -> Array:
        restored: Array = values * self.half + self.middle
        return restored


class BackPropagation:
    """The paper's BP network: tanh layers of `hidden`, trained by Levenberg–Marquardt as in MATLAB's `fitnet`."""

    def __init__(self, hidden: tuple[int, ...] = (10,), steps: int = 200, seed: int = 0) -> None:
        self.hidden = hidden
        self.steps = steps
        self.seed = seed

    def fit(self, inputs: Array, target: Array, weight: Array | None = None) -> BackPropagation:
        self._inputs, self._target = Span.of(inputs), Span.of(target)
        start = Layers.drawn((inputs.shape[1], *self.hidden, target.shape[1]), np.random.default_rng(self.seed))
        even = np.ones(target.shape) if weight is None else np.repeat(weight[:, None], target.shape[1], axis=1)
        self.layers = train(start, self._inputs.shrunk(inputs), self._target.shrunk(target), even, self.steps)
        return self

    def predict(self, inputs: Array) -> Array:
        return self._target.restored(self.layers(self._inputs.shrunk(inputs)))


class RadialBasis:
    """The paper's RBF network: Gaussians around `centres` of the inputs, with weights by ridge regression.

    spread: of the Gaussians, for inputs scaled to ±1; None: twice the mean distance of neighbouring centres.
    """

    def __init__(self, centres: int = 150, spread: float | None = None, ridge: float = 1e-10, seed: int = 0) -> None:
        self.centres = centres
        self.spread = spread
        self.ridge = ridge
        self.seed = seed

    def fit(self, inputs: Array, target: Array, weight: Array | None = None) -> RadialBasis:
        from sklearn.cluster import KMeans  # takes a second to import

        self._inputs, self._target = Span.of(inputs), Span.of(target)
        shrunk = self._inputs.shrunk(inputs)
        with threadpool_limits(1):
            means = KMeans(min(self.centres, len(inputs)), n_init=1, random_state=self.seed).fit(shrunk)
        self._centre = np.asarray(means.cluster_centers_, dtype=float)
        self._spread = self.spread or 2.0 * float(np.mean(_to_nearest(self._centre)))
        basis = self._basis(shrunk)
        weighted = basis.T if weight is None else basis.T * weight
        normal = weighted @ basis
        normal += self.ridge * np.trace(normal) / len(normal) * np.eye(len(normal))
        self._coefficient = np.linalg.solve(normal, weighted @ self._target.shrunk(target))
        return self

    def predict(self, inputs: Array) -> Array:
        return self._target.restored(self._basis(self._inputs.shrunk(inputs)) @ self._coefficient)

    def _basis(self, shrunk: Array) -> Array:
        gaussians = np.exp(-0.5 * squared_distance(shrunk, self._centre) / self._spread**2)
        return np.column_stack([gaussians, np.ones(len(shrunk))])


def squared_distance(one: Array, other: Array) -> Array:
    square = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2.0 * one @ other.T
    positive: Array = np.maximum(square, 0.0)
    return positive


def _to_nearest(centre: Array) -> Array:
    distance = np.sqrt(squared_distance(centre, centre))
    np.fill_diagonal(distance, np.inf)
    nearest: Array = distance.min(axis=1)
    return nearest
