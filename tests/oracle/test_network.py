"""The contact network against its equations in double precision, and its Jacobian against differences of those.

With s the displacement from rest times a scale, and u = s/sqrt(s·s + softening):
contact = W₃ᵀ tanh(W₂ᵀ tanh(W₁ᵀ(s, u) + b₁) + b₂) + b₃.
"""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.contact import _contact
from oracle.field import Array, differences

POSE, SCALED = 6, 5
OF_A_FLOAT = 2e-5  # rounding of sums of a hundred floats of the order of one


class Network:
    """One of random weights."""

    def __init__(self, seed: int, hidden: int, outputs: int) -> None:
        random = np.random.default_rng((seed, hidden))
        layers = [(2 * SCALED, hidden), (hidden,), (hidden, hidden), (hidden,), (hidden, outputs), (outputs,)]
        shapes = [(POSE,), (POSE, SCALED), *layers]
        self.softening = 0.05
        self.parts = [random.normal(size=shape) / np.sqrt(shape[0]) for shape in shapes]
        head = [float(hidden), float(outputs), self.softening]
        self.vector = np.concatenate([head, *(part.ravel() for part in self.parts)]).astype(np.float32)
        self.parts = [part.astype(np.float32).astype(float) for part in self.parts]

    def contact(self, pose: Array) -> Array:
        rest, scale, w1, b1, w2, b2, w3, b3 = self.parts
        s = (pose - rest) @ scale
        u = s / np.sqrt(s @ s + np.float32(self.softening))
        return np.asarray(np.tanh(np.tanh(np.concatenate([s, u]) @ w1 + b1) @ w2 + b2) @ w3 + b3)


@pytest.mark.parametrize(("hidden", "outputs"), [(1, 3), (7, 5), (48, 3), (64, 5)])
def test_network_and_its_slope_are_those_of_its_equations(hidden: int, outputs: int) -> None:
    for seed in range(10):
        network = Network(seed, hidden, outputs)
        pose = np.random.default_rng(seed).normal(size=POSE).astype(np.float32)
        contact, jacobian = np.empty(outputs, np.float32), np.empty((outputs, POSE), np.float32)
        _contact.infer(network.vector.tobytes(), pose.data, contact.data, jacobian.ravel().data)
        slope = differences(network.contact, pose.astype(float), np.full(POSE, 1e-3))
        assert contact == pytest.approx(network.contact(pose.astype(float)), abs=OF_A_FLOAT)
        assert jacobian == pytest.approx(slope, abs=OF_A_FLOAT * max(np.abs(slope).max(), 1.0))
