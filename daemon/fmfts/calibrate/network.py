"""The regressor: pose → location and force, two small tanh networks on features that suit the pad."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array

# One unit of each pose component, mm and rad: a frame's noise is then about 0.04 of each, and a firm press 1 to 4.
SCALE = np.array([0.2, 0.2, 0.6, 0.05, 0.05])
SOFTENING = 0.05
DIRECTION_GAIN = 8.0  # directions matter most; training finds that sooner when they are the larger inputs
HIDDEN = (32, 32)
CHUNK_ITERATIONS = 600
MOST_CHUNKS = 3
SETTLED = 0.97  # a chunk that lowers the held-out error by less than 3 % is the last


def features(pose: Array, rest_pose: Array) -> Array:
    """(K, 10) of pose (K, 6): the scaled displacement s, and its direction 8 s/√(|s|² + ε²).

    A pad answers a push almost in proportion, so the direction tells the place whatever the force: a network that has
    to find this out by itself is biased at light touch. ε keeps the direction of mere noise short.
    """
    scaled = (pose - rest_pose)[:, :5] / SCALE
    length = np.sqrt(np.sum(scaled**2, axis=1, keepdims=True) + SOFTENING**2)
    return np.concatenate([scaled, DIRECTION_GAIN * scaled / length], axis=1)


@dataclass(frozen=True, slots=True)
class Layers:
    """Weights and biases of input → tanh → tanh → output."""

    weight: tuple[Array, Array, Array]
    bias: tuple[Array, Array, Array]

    def __call__(self, inputs: Array) -> Array:
        first = np.tanh(inputs @ self.weight[0] + self.bias[0])
        second = np.tanh(first @ self.weight[1] + self.bias[1])
        output: Array = second @ self.weight[2] + self.bias[2]
        return output

    def beside(self, other: Layers) -> Layers:
        """Both networks as one with the outputs of both: block-diagonal weights."""
        return Layers(
            (
                np.concatenate([self.weight[0], other.weight[0]], axis=1),
                _block_diagonal(self.weight[1], other.weight[1]),
                _block_diagonal(self.weight[2], other.weight[2]),
            ),
            tuple(np.concatenate(pair) for pair in zip(self.bias, other.bias, strict=True)),  # type: ignore[arg-type]
        )


@dataclass(frozen=True, slots=True)
class Problem:
    """What one network learns: inputs (K, 10) → target (K, m), each row with its weight; judged on held-out rows."""

    inputs: Array
    target: Array
    weight: Array
    held_out_inputs: Array
    held_out_target: Array
    held_out_weight: Array

    def train(self) -> tuple[Layers, list[float]]:
        """The network, and its held-out error after every chunk of L-BFGS; the same for the same problem."""
        scale = np.abs(self.target).max()
        network = MLPRegressor(
            hidden_layer_sizes=HIDDEN, activation="tanh", solver="lbfgs", alpha=1e-7, max_iter=CHUNK_ITERATIONS,
            max_fun=100 * CHUNK_ITERATIONS, tol=1e-10, warm_start=True, random_state=0,
        )  # fmt: skip
        errors: list[float] = []
        for _ in range(MOST_CHUNKS):
            with warnings.catch_warnings(), threadpool_limits(1):  # one thread: sums in one order, the same weights
                warnings.simplefilter("ignore", ConvergenceWarning)  # a chunk is meant to stop before convergence
                network.fit(self.inputs, np.squeeze(self.target / scale), sample_weight=self.weight)
            layers = _layers(network, scale)
            wrong = np.sum((layers(self.held_out_inputs) - self.held_out_target) ** 2, axis=1)
            errors.append(float(np.sqrt(np.average(wrong, weights=self.held_out_weight))))
            if len(errors) > 1 and errors[-1] > SETTLED * errors[-2]:
                break
        return layers, errors


def _layers(network: MLPRegressor, scale: float) -> Layers:
    first, second, third = network.coefs_
    bias_1, bias_2, bias_3 = network.intercepts_
    return Layers((first, second, third * scale), (bias_1, bias_2, bias_3 * scale))


def _block_diagonal(upper: Array, lower: Array) -> Array:
    block = np.zeros((upper.shape[0] + lower.shape[0], upper.shape[1] + lower.shape[1]))
    block[: upper.shape[0], : upper.shape[1]] = upper
    block[upper.shape[0] :, upper.shape[1] :] = lower
    return block
