"""Trains the network that ships: pose → press, by small tanh networks side by side, on features that suit the pad."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fmfts.pad import Array
from fmfts_calibrate.levenberg import Layers, train
from fmfts_calibrate.samples import Samples

SOFTENING = 0.05
NOISE_IN_UNIT = 16.0
DIRECTION_GAIN = 8.0  # directions matter most; training learns that sooner when they are the larger inputs
# Training does not try to make errors smaller than these.
WORTHWHILE_MM, WORTHWHILE_N = 0.05, 0.004
# Limit of a force's bound, which would be infinite at rest, where the place is unknown.
LARGEST_FORCE_BOUND_N = 0.5
# Place, normal force and shear have separate networks, with their own weights and smaller matrices to solve.
GROUPS = (slice(0, 2), slice(2, 3), slice(3, 5))
STEPS = 80


@dataclass(frozen=True, slots=True)
class ContactNetwork:
    """rest_pose (6,). scale (5,): the unit of each pose component, in mm and rad. layers: take the features."""

    rest_pose: Array
    scale: Array
    layers: Layers

    def __call__(self, pose: Array) -> Array:
        """(K, 3 or 5) presses of poses (K, 6)."""
        return self.layers(features(pose, self.rest_pose, self.scale))


def features(pose: Array, rest_pose: Array, scale: Array) -> Array:
    """(K, 10) features of poses (K, 6): the scaled displacement s, and its direction 8 s/√(|s|² + ε²).

    The displacement is almost proportional to the force, so its direction tells the place at any force. A network that
    must learn this by itself is biased at light touch. ε keeps the direction short where s is only noise.
    """
    scaled = (pose - rest_pose)[:, :5] / scale
    length = np.sqrt(np.sum(scaled**2, axis=1, keepdims=True) + SOFTENING**2)
    return np.concatenate([scaled, DIRECTION_GAIN * scaled / length], axis=1)


def train_network(
    samples: Samples,
    rest_pose: Array,
    hidden: int,
    steps: int = STEPS,
    seed: int = 0,
    done: Callable[[float], None] = lambda _: None,
) -> ContactNetwork:
    """Train two hidden layers of `hidden` for each group of outputs, with errors weighted by the bound.

    The same samples give the same weights. done: takes the share of the steps that are taken.
    """
    scale = unit_of(samples, rest_pose)
    inputs = features(samples.pose, rest_pose, scale)
    together: Layers | None = None
    groups = GROUPS[: 2 if samples.press.shape[1] == 3 else 3]

    def stepped(number: int, step: int) -> None:
        done((number + step / steps) / len(groups))

    for number, group in enumerate(groups):
        target = samples.press[:, group]
        largest = np.abs(target).max(axis=0)
        sizes = (inputs.shape[1], hidden, hidden, target.shape[1])
        start = Layers.drawn(sizes, np.random.default_rng([seed, group.start]))
        layers = train(
            start, inputs, target / largest, weights(samples, group), steps, done=partial(stepped, number)
        ).scaled(0.0 * largest, largest)
        together = layers if together is None else together.beside(layers)
    assert together is not None
    return ContactNetwork(rest_pose, scale, together)


def unit_of(samples: Samples, rest_pose: Array) -> Array:
    """(5,) unit of each pose component: its rms change by presses, but at least NOISE_IN_UNIT times its noise.

    Otherwise a component that is mostly noise (a magnet hardly moves sideways) would dominate the direction.
    """
    typical = np.sqrt(np.mean((samples.pose - rest_pose)[:, :5] ** 2, axis=0))
    noise = np.sqrt(np.mean(np.einsum("kii->ki", samples.covariance), axis=0))
    unit: Array = np.maximum(typical, NOISE_IN_UNIT * noise)
    return unit


def weights(samples: Samples, group: slice) -> Array:
    """(K, m) weights 1/(bound² + worthwhile²), with a mean of one; the same for all outputs of a group."""
    square = np.mean(samples.bound[:, group] ** 2, axis=1)
    if group.start == 0:
        weight = 1.0 / (square + WORTHWHILE_MM**2)
    else:
        weight = 1.0 / (np.minimum(square, LARGEST_FORCE_BOUND_N**2) + WORTHWHILE_N**2)
    return np.repeat((weight / weight.mean())[:, None], group.stop - group.start, axis=1)


def error_in_bounds(error: Array, bound: Array) -> Array:
    """(3 or 5,) rms of error / √(bound² + worthwhile²)."""
    worth = np.array([WORTHWHILE_MM] * 2 + [WORTHWHILE_N] * (error.shape[1] - 2))
    share: Array = np.sqrt(np.mean(error**2 / (bound**2 + worth**2), axis=0))
    return share
