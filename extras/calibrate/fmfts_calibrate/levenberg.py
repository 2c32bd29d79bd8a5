"""Trains networks of tanh layers by Levenberg–Marquardt, like MATLAB's `trainlm`, with a weight for every row.

Hagan and Menhaj, "Training feedforward networks with the Marquardt algorithm", IEEE Trans. Neural Networks 5 (1994).
For a thousand parameters or fewer, tens of its steps reach more than tens of thousands of gradient descent.

It does not call arithmetic/descent.c, which is for a few unknowns: of 443 parameters LAPACK solves the normal equations
in 3 ms, matrix.c in 10, of 1,103 in 30 and 190. The same bits on every processor are not needed here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array

FIRST_DAMPING, DAMPING_FACTOR, MOST_DAMPING = 1e-2, 10.0, 1e10
ROWS_AT_ONCE = 2000


@dataclass(frozen=True, slots=True)
class Layers:
    """Weights and biases of input → tanh … tanh → output."""

    weight: tuple[Array, ...]
    bias: tuple[Array, ...]

    @classmethod
    def drawn(cls, sizes: tuple[int, ...], random: np.random.Generator) -> Layers:
        """Random weights with a spread (Glorot) that keeps the activations in the curved part of tanh."""
        pairs = list(pairwise(sizes))
        return cls(
            tuple(random.standard_normal(pair) * np.sqrt(2.0 / sum(pair)) for pair in pairs),
            tuple(random.standard_normal(outputs) * 0.1 for _, outputs in pairs),
        )

    def __call__(self, inputs: Array) -> Array:
        return self._activations(inputs)[-1]

    @property
    def parameters(self) -> int:
        return sum(array.size for array in self.weight + self.bias)

    def vector(self) -> Array:
        return np.concatenate([array.ravel() for pair in zip(self.weight, self.bias, strict=True) for array in pair])

    def with_vector(self, vector: Array) -> Layers:
        """Layers of the same sizes, with the parameters of `vector`."""
        weights, biases, position = [], [], 0
        for weight, bias in zip(self.weight, self.bias, strict=True):
            weights.append(vector[position : position + weight.size].reshape(weight.shape))
            biases.append(vector[position + weight.size : position + weight.size + bias.size])
            position += weight.size + bias.size
        return type(self)(tuple(weights), tuple(biases))

    def scaled(self, shift: Array, scale: Array) -> Layers:
        """The network whose outputs are `shift` + `scale` · the outputs of this one."""
        weight, bias = (*self.weight[:-1], self.weight[-1] * scale), (*self.bias[:-1], self.bias[-1] * scale + shift)
        return type(self)(weight, bias)

    def beside(self, other: Layers) -> Layers:
        """One network with the outputs of both, on the same inputs."""
        first = np.concatenate([self.weight[0], other.weight[0]], axis=1)
        blocks = [_block_diagonal(*pair) for pair in zip(self.weight[1:], other.weight[1:], strict=True)]
        return Layers((first, *blocks), tuple(np.concatenate(pair) for pair in zip(self.bias, other.bias, strict=True)))

    def _activations(self, inputs: Array) -> list[Array]:
        activations = [inputs]
        last = len(self.weight) - 1
        for layer, (weight, bias) in enumerate(zip(self.weight, self.bias, strict=True)):
            values = activations[-1] @ weight + bias
            activations.append(values if layer == last else np.tanh(values))
        return activations

    def slopes(self, inputs: Array) -> Iterator[tuple[Array, Array]]:
        """For each output, its values (K,) and derivatives (K, parameters)."""
        activations = self._activations(inputs)
        for output in range(self.weight[-1].shape[1]):
            back = np.zeros_like(activations[-1])
            back[:, output] = 1.0
            columns: list[Array] = []
            for layer in reversed(range(len(self.weight))):
                by_weight = activations[layer][:, :, None] * back[:, None, :]
                columns[:0] = [by_weight.reshape(len(inputs), -1), back]
                if layer:
                    back = (back @ self.weight[layer].T) * (1.0 - activations[layer] ** 2)
            yield activations[-1][:, output], np.concatenate(columns, axis=1)


def train(
    layers: Layers,
    inputs: Array,
    target: Array,
    weight: Array,
    steps: int,
    settled: float = 1e-4,
    done: Callable[[int], None] = lambda _: None,
) -> Layers:
    """`layers` fitted to target (K, m); weight (K, m): of each row and output in the squared error.

    Ends after `steps` accepted steps, or when five steps in a row lower the error by less than the share `settled`.
    done: takes the number of each accepted step.
    Runs on one thread, so that sums have one order: the same problem gives the same weights.
    """
    with threadpool_limits(1):
        root = np.sqrt(weight)
        error = _error(layers, inputs, target, root)
        damping, stalled = FIRST_DAMPING, 0
        for step in range(steps):
            normal, gradient = _normal_equations(layers, inputs, target, root)
            diagonal = np.diagonal(normal).copy()
            while damping < MOST_DAMPING:
                damped = normal + np.diag(damping * (diagonal + 1e-6 * diagonal.mean()))
                trial = layers.with_vector(layers.vector() + np.linalg.solve(damped, gradient))
                trial_error = _error(trial, inputs, target, root)
                if trial_error < error:
                    break
                damping *= DAMPING_FACTOR
            else:
                break
            stalled = stalled + 1 if error - trial_error < settled * error else 0
            layers, error, damping = trial, trial_error, damping / DAMPING_FACTOR
            done(step + 1)
            if stalled == 5:
                break
    return layers


def _error(layers: Layers, inputs: Array, target: Array, root: Array) -> float:
    return float(np.sum(((layers(inputs) - target) * root) ** 2))


def _normal_equations(layers: Layers, inputs: Array, target: Array, root: Array) -> tuple[Array, Array]:
    size = layers.parameters
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for first in range(0, len(inputs), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        for output, (value, slope) in enumerate(layers.slopes(inputs[rows])):
            weighted = slope * root[rows, output, None]
            normal += weighted.T @ weighted
            gradient += weighted.T @ ((target[rows, output] - value) * root[rows, output])
    return normal, gradient


def _block_diagonal(upper: Array, lower: Array) -> Array:
    block = np.zeros((upper.shape[0] + lower.shape[0], upper.shape[1] + lower.shape[1]))
    block[: upper.shape[0], : upper.shape[1]] = upper
    block[upper.shape[0] :, upper.shape[1] :] = lower
    return block
