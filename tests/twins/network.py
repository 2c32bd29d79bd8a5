"""The contact network of contact/graph.py in NumPy, in float32.

Not a witness: it was the daemon's own, and holds network.c to the last bit. onnxruntime judges both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.graph import FEATURES, SCALED
from fmfts.contact.inference import POSE, NetworkInference

Vector = NDArray[np.float32]
LANES = 8
HEAD = 3  # hidden units, outputs, softening


class ReferenceInference(NetworkInference):
    """network: as `network_of` returns it."""

    by = "numpy"

    def __init__(self, network: Vector) -> None:
        hidden, outputs = int(network[0]), int(network[1])
        super().__init__(network)
        self._softening = network[2]
        layers = [(FEATURES, hidden), (hidden,), (hidden, hidden), (hidden,), (hidden, outputs), (outputs,)]
        parts, first = [], HEAD
        for shape in [(POSE,), (POSE, SCALED), *layers]:
            parts.append(network[first : first + np.prod(shape)].reshape(shape))
            first += int(np.prod(shape))
        self._rest, self._by_scale, self._w1, self._b1, self._w2, self._b2, self._w3, self._b3 = parts

    def run(self) -> None:
        scaled = _affine(self.pose - self._rest, self._by_scale, np.zeros(SCALED, np.float32))
        square = np.float32(0.0)
        for value in scaled:
            square = square + value * value
        length = np.sqrt(square + self._softening)
        direction = scaled / length
        hidden_1 = _tanh(_affine(np.concatenate([scaled, direction]), self._w1, self._b1))
        hidden_2 = _tanh(_affine(hidden_1, self._w2, self._b2))
        self.contact[:] = _affine(hidden_2, self._w3, self._b3)
        one = np.float32(1.0)
        slope_1, slope_2 = one - hidden_1 * hidden_1, one - hidden_2 * hidden_2
        for output, by_pose in enumerate(self.jacobian):
            by_sum_2 = self._w3[:, output] * slope_2
            by_sum_1 = _dots(self._w2, by_sum_2) * slope_1
            by_feature = _dots(self._w1, by_sum_1)
            by_scaled, by_direction = by_feature[:SCALED], by_feature[SCALED:]
            along = np.float32(0.0)
            for one_by, one_direction in zip(by_direction, direction, strict=True):
                along = along + one_by * one_direction
            by_scaled = by_scaled + (by_direction - along * direction) / length
            by_pose[:] = _affine(by_scaled, self._by_scale.T, np.zeros(POSE, np.float32))


def _affine(values: Vector, weight: Vector, bias: Vector) -> Vector:
    """bias + values · weight, summed in the order of `values`."""
    out = bias.copy()
    for value, row in zip(values, weight, strict=True):
        out += value * row
    return out


def _dots(rows: Vector, vector: Vector) -> Vector:
    """The dot product of each row with `vector`. It sums in LANES lanes, and then adds these in pairs."""
    product = rows * vector
    lanes = np.zeros((len(rows), LANES), np.float32)
    for first in range(0, len(vector), LANES):
        part = product[:, first : first + LANES]
        lanes[:, : part.shape[1]] += part
    even = (lanes[:, 0] + lanes[:, 4]) + (lanes[:, 2] + lanes[:, 6])
    odd = (lanes[:, 1] + lanes[:, 5]) + (lanes[:, 3] + lanes[:, 7])
    return even + odd


def _tanh(value: Vector) -> Vector:
    """tanh: Lambert's continued fraction at value/4, then tanh 2x = 2 tanh x / (1 + tanh² x) twice."""
    x = np.clip(value, np.float32(-9.0), np.float32(9.0)) * np.float32(0.25)
    c, square = [np.float32(each) for each in (135135, 17325, 378, 62370, 3150, 28, 1, 2)], x * x
    t = x * (c[0] + square * (c[1] + square * (c[2] + square)))
    t = t / (c[0] + square * (c[3] + square * (c[4] + square * c[5])))
    t = c[7] * t / (c[6] + t * t)
    return c[7] * t / (c[6] + t * t)  # type: ignore[no-any-return]
