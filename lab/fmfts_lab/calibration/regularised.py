"""Trains regularised networks, for a few hundred noise-free rows, as the paper's networks have.

Least squares alone oscillates between so few rows. Here the weights are kept small unless the rows require more. How
small is estimated from the rows themselves (tanh network), or from left-out rows (radial bases).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array
from fmfts_calibrate.levenberg import Layers
from fmfts_lab.calibration.regressors import Span, squared_distance

FIRST_PRECISION, FIRST_DECAY = 1.0, 1e-3
FIRST_DAMPING, DAMPING_FACTOR, MOST_DAMPING = 1e-2, 10.0, 1e10
SETTLED, STALLED_STEPS = 1e-6, 5
FAINTEST = 1e-9  # weakest component, relative to the strongest: weaker ones come from constant or repeated columns


@dataclass(frozen=True, slots=True)
class Components:
    """Scales columns to ±1, then to principal components of unit variance, like MATLAB's `mapminmax` and `processpca`.

    The twelve values of a field depend on five numbers, and mostly on one; this makes the weak ones visible too.
    """

    span: Span
    mean: Array
    turn: Array

    @classmethod
    def of(cls, values: Array) -> Components:
        span = Span.of(values)
        shrunk = span.shrunk(values)
        mean = shrunk.mean(axis=0)
        _, strength, axes = np.linalg.svd(shrunk - mean, full_matrices=False)
        kept = strength > FAINTEST * strength[0]
        return cls(span, mean, axes[kept].T / (strength[kept] / np.sqrt(len(values))))

    def shrunk(self, values: Array) -> Array:
        shrunk: Array = (self.span.shrunk(values) - self.mean) @ self.turn
        return shrunk


@dataclass(frozen=True, slots=True)
class Step:
    """layers: after the step. squared_error: mean, for a target scaled to ±1. effective: number of parameters that the
    rows determine."""

    layers: Layers
    squared_error: float
    effective: float


def bayesian_steps(layers: Layers, inputs: Array, target: Array) -> Iterator[Step]:
    """Yields Levenberg–Marquardt steps on β·(squared errors) + α·(squared weights), until they no longer help.

    After every step α and β are set to the values that make the rows most probable: MacKay, "Bayesian interpolation",
    Neural Computation 4 (1992); Foresee and Hagan, "Gauss-Newton approximation to Bayesian learning", ICNN 1997.
    MATLAB's `trainbr` does the same.
    """
    identity, vector = np.eye(layers.parameters), layers.vector()
    precision, decay, damping, stalled = FIRST_PRECISION, FIRST_DECAY, FIRST_DAMPING, 0
    error, slope = _linearised(layers, inputs, target)
    while stalled < STALLED_STEPS:
        normal, gradient = precision * slope.T @ slope, precision * slope.T @ error - decay * vector
        before = precision * error @ error + decay * vector @ vector
        while damping < MOST_DAMPING:
            trial = vector + np.linalg.solve(normal + (decay + damping) * identity, gradient)
            trial_error = (target - layers.with_vector(trial)(inputs)).T.ravel()
            after = precision * trial_error @ trial_error + decay * trial @ trial
            if after < before:
                break
            damping *= DAMPING_FACTOR
        else:
            return
        stalled = stalled + 1 if before - after < SETTLED * before else 0
        layers, vector, damping = layers.with_vector(trial), trial, damping / DAMPING_FACTOR
        error, slope = _linearised(layers, inputs, target)
        variance = np.linalg.inv(precision * slope.T @ slope + decay * identity)
        effective = float(len(vector) - decay * np.trace(variance))
        decay = effective / float(vector @ vector)
        precision = (len(error) - effective) / float(error @ error)
        yield Step(layers, float(np.mean(error**2)), effective)


class BayesianNetwork:
    """The paper's BP network, regularised for a few hundred rows; the best of some starts.

    hidden: sizes of tanh layers. decorrelated: scale the inputs to principal components, not column by column.
    """

    def __init__(
        self, hidden: tuple[int, ...], steps: int = 200, decorrelated: bool = False, starts: int = 1, seed: int = 0
    ) -> None:
        self.hidden = hidden
        self.steps = steps
        self.decorrelated = decorrelated
        self.starts = starts
        self.seed = seed

    def fit(self, inputs: Array, target: Array, weight: Array | None = None) -> BayesianNetwork:
        """Fit, and keep the start with the smallest generalised cross-validation error."""
        if weight is not None:
            raise ValueError("a Bayesian network takes no weights: it estimates the noise itself")
        starts = [self._last_step(inputs, target, start) for start in range(self.starts)]
        best = min(starts, key=lambda step: step.squared_error / (1.0 - step.effective / target.size) ** 2)
        self.layers = best.layers
        return self

    def steps_of(self, inputs: Array, target: Array, start: int = 0) -> Iterator[Step]:
        """Yields the steps of training from one start; after each, `predict` uses its network."""
        self._inputs = scaling(inputs, self.decorrelated)
        self._target = Span.of(target)
        shrunk = self._inputs.shrunk(inputs)
        random = np.random.default_rng([self.seed, start])
        layers = Layers.drawn((shrunk.shape[1], *self.hidden, target.shape[1]), random)
        # One thread, so that sums have a fixed order: the same rows give the same weights.
        with threadpool_limits(1):
            for step in islice(bayesian_steps(layers, shrunk, self._target.shrunk(target)), self.steps):
                self.layers = step.layers
                yield step

    def _last_step(self, inputs: Array, target: Array, start: int) -> Step:
        *_, last = self.steps_of(inputs, target, start)
        return last

    def predict(self, inputs: Array) -> Array:
        return self._target.restored(self.layers(self._inputs.shrunk(inputs)))


class RegularisedBasis:
    """The paper's RBF network with a Gaussian at every row, like MATLAB's `newrbe`, smoothed by `ridge`.

    Poggio and Girosi, "Networks for approximation and learning", Proc. IEEE 78 (1990). spread: of the Gaussians, for
    scaled inputs. ridge: for each row, as a share of a Gaussian's height.
    """

    def __init__(self, spread: float, ridge: float, decorrelated: bool = False) -> None:
        self.spread = spread
        self.ridge = ridge
        self.decorrelated = decorrelated

    def fit(self, inputs: Array, target: Array, weight: Array | None = None) -> RegularisedBasis:
        if weight is not None:
            raise ValueError("these radial bases take no weights: all rows are smoothed alike")
        self._inputs, self._target = scaling(inputs, self.decorrelated), Span.of(target)
        self._centre = self._inputs.shrunk(inputs)
        smoothed = self._basis(self._centre) + self.ridge * len(inputs) * np.eye(len(inputs))
        self._coefficient = np.linalg.solve(smoothed, self._target.shrunk(target))
        return self

    def predict(self, inputs: Array) -> Array:
        return self._target.restored(self._basis(self._inputs.shrunk(inputs)) @ self._coefficient)

    def _basis(self, shrunk: Array) -> Array:
        gaussians: Array = np.exp(-0.5 * squared_distance(shrunk, self._centre) / self.spread**2)
        return gaussians


def scaling(inputs: Array, decorrelated: bool) -> Components | Span:
    return Components.of(inputs) if decorrelated else Span.of(inputs)


def _linearised(layers: Layers, inputs: Array, target: Array) -> tuple[Array, Array]:
    """Errors (m·K,), output after output, and the derivatives of the outputs (m·K, parameters)."""
    values, slopes = zip(*layers.slopes(inputs), strict=True)
    return target.T.ravel() - np.concatenate(values), np.concatenate(slopes)
