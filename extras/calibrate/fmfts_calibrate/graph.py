"""The graph that `calibrate` exports: from features of a pose, through tanh layers, to the contact and its Jacobian.

It is defined only here: export.py writes it as ONNX, and contact/network.c computes it from its `weights`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array

SCALED = 5  # components of a displacement from rest; the axis's last one follows from the others
FEATURES = 2 * SCALED
CONCAT_AXIS = 1

# name = operation(inputs). Shapes: s, u (N, 5); h1, h2 (N, hidden); …3 (N, 1, …) or (N, outputs, …) for the chain rule.
FORWARD = """
centred = Sub(pose, rest)
s = MatMul(centred, by_scale)
square = Mul(s, s)
sum = ReduceSum(square, last)
softened = Add(sum, softening)
length = Sqrt(softened)
u = Div(s, length)
f = Concat(s, u)
a1w = MatMul(f, w1)
a1 = Add(a1w, b1)
h1 = Tanh(a1)
a2w = MatMul(h1, w2)
a2 = Add(a2w, b2)
h2 = Tanh(a2)
a3 = MatMul(h2, w3)
contact = Add(a3, b3)
"""
BACKWARD = """
h1_square = Mul(h1, h1)
h1_slope = Sub(one, h1_square)
h1_slope3 = Unsqueeze(h1_slope, middle)
h2_square = Mul(h2, h2)
h2_slope = Sub(one, h2_square)
h2_slope3 = Unsqueeze(h2_slope, middle)
by_a2 = Mul(w3_t, h2_slope3)
by_h1 = MatMul(by_a2, w2_t)
by_a1 = Mul(by_h1, h1_slope3)
by_s_direct = MatMul(by_a1, w1_t_of_s)
by_u = MatMul(by_a1, w1_t_of_u)
u3 = Unsqueeze(u, middle)
length3 = Unsqueeze(length, middle)
along = Mul(by_u, u3)
along_sum = ReduceSum(along, last3)
radial = Mul(along_sum, u3)
across = Sub(by_u, radial)
by_s_turned = Div(across, length3)
by_s = Add(by_s_direct, by_s_turned)
jacobian = MatMul(by_s, by_scale_t)
"""
AXES = {"last": 1, "middle": 1, "last3": 2}  # integer constants


class Node(NamedTuple):
    operation: str
    inputs: tuple[str, ...]
    output: str

    @classmethod
    def parse(cls, line: str) -> Node:
        output, call = line.split(" = ")
        operation, inputs = call.rstrip(")").split("(")
        return cls(operation, tuple(inputs.split(", ")), output)


NODES = tuple(Node.parse(line) for line in (FORWARD + BACKWARD).splitlines() if line)


def constants(
    rest_pose: Array, by_scale: Array, softening: float, weight: Sequence[Array], bias: Sequence[Array]
) -> dict[str, NDArray[np.float32]]:
    """The graph's constants, from rest_pose (6,), by_scale (6, 5), and the weights and biases of three layers."""
    (w1, w2, w3), (b1, b2, b3) = weight, bias
    whole = {
        "rest": rest_pose[None], "by_scale": by_scale, "by_scale_t": by_scale.T,
        "softening": np.array([softening]), "one": np.array([1.0]),
        "w1": w1, "w2": w2, "w3": w3, "b1": b1, "b2": b2, "b3": b3,
        "w1_t_of_s": w1.T[:, :SCALED], "w1_t_of_u": w1.T[:, SCALED:], "w2_t": w2.T, "w3_t": w3.T[None],
    }  # fmt: skip
    return {name: np.ascontiguousarray(value, dtype=np.float32) for name, value in whole.items()}


def weights(constants: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """The independent constants, as network.h describes them."""
    head = [*constants["w3"].shape, constants["softening"][0]]
    order = ("rest", "by_scale", "w1", "b1", "w2", "b2", "w3", "b3")
    return np.concatenate([np.array(head, dtype=np.float32), *(constants[name].ravel() for name in order)])
