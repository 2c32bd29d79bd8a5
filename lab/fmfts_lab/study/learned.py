"""Methods that learn the pad from examples: look-up, nearest neighbours, and networks through ONNX.

Their examples are better than any calibration of a user: thousands of noise-free presses of the same pad on which they
are judged, at its nominal remanence.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from scipy.spatial import cKDTree

from fmfts.contact.contract import IR_VERSION, OPSET
from fmfts.pad import Array
from fmfts_lab.calibration.regressors import BackPropagation, RadialBasis
from fmfts_lab.calibration.simulated import pressed_fields
from fmfts_lab.study.world import World
from fmfts_simulation.solved_table import standard_mechanics

EXAMPLES, LARGEST_N, EDGE_MM = 6000, 2.4, 14.0
SEED = 3


class Examples(NamedTuple):
    """press (K, 3): x, y in mm, force in N; pose (K, 6): m and unit axis; field_t (K, 3N)."""

    press: Array
    pose: Array
    field_t: Array


def examples(world: World, count: int = EXAMPLES) -> Examples:
    """Presses spread over the pad as drawn; a twentieth of them have no force."""
    pad, random = world.drawing, np.random.default_rng(SEED)
    press = random.uniform([-EDGE_MM, -EDGE_MM, 0.0], [EDGE_MM, EDGE_MM, LARGEST_N], (count, 3))
    press[::20, 2] = 0.0
    displacement, axis = standard_mechanics().displacement(press[:, 0] * 1e-3, press[:, 1] * 1e-3, press[:, 2])
    fields = pressed_fields(pad, press)
    return Examples(press, np.column_stack([pad.rest_position_m + displacement, axis]), fields.reshape(count, -1))


class Nearest:
    """The mean of the `count` examples with the nearest fields, weighted by 1/distance; with one, a look-up table."""

    def __init__(self, fields_t: Array, target: Array, count: int) -> None:
        self._tree, self._target, self._count = cKDTree(fields_t), target, count

    def __call__(self, field_t: Array) -> Array:
        distance, index = self._tree.query(field_t, self._count)
        if self._count == 1:
            return np.asarray(self._target[index])
        weight = 1.0 / np.maximum(distance, 1e-12)
        found: Array = weight @ self._target[index] / weight.sum()
        return found


class Network:
    """A regressor as an ONNX session with one thread. Call it with (d,) or (K, d)."""

    def __init__(self, regressor: BackPropagation | RadialBasis, kind: type[np.floating[Any]] = np.float32) -> None:
        self._kind = kind
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(
            exported(regressor, kind), options, providers=["CPUExecutionProvider"]
        )

    def __call__(self, inputs: Array) -> Array:
        rows = np.atleast_2d(inputs).astype(self._kind)
        found: Array = self._session.run(None, {"inputs": rows})[0]
        return found[0] if inputs.ndim == 1 else found


def exported(regressor: BackPropagation | RadialBasis, kind: type[np.floating[Any]]) -> bytes:
    """The regressor in ONNX, computed in float32 or float64."""
    constants: dict[str, Array] = {}
    nodes: list[onnx.NodeProto] = []

    def step(operation: str, *inputs: str, **more: Array) -> str:
        constants.update(more)
        name = f"v{len(nodes)}"
        nodes.append(helper.make_node(operation, [*inputs, *more], [name]))
        return name

    first, last = regressor._inputs, regressor._target
    found = step("Div", step("Sub", "inputs", middle=first.middle), half=first.half)
    if isinstance(regressor, BackPropagation):
        layers = regressor.layers
        for number, (weight, bias) in enumerate(zip(layers.weight, layers.bias, strict=True)):
            found = step("Tanh", found) if number else found
            found = step("MatMul", found, **{f"w{number}": weight})
            found = step("Add", found, **{f"b{number}": bias})
    else:
        found = _radial(regressor, step, found)
    found = step("Mul", found, out_half=last.half)
    found = step("Add", found, out_middle=last.middle)
    element = TensorProto.FLOAT if kind is np.float32 else TensorProto.DOUBLE
    graph = helper.make_graph(
        nodes,
        "regressor",
        [helper.make_tensor_value_info("inputs", element, ["N", len(first.middle)])],
        [helper.make_tensor_value_info(found, element, ["N", len(last.middle)])],
        [numpy_helper.from_array(np.asarray(value, dtype=kind), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    onnx.checker.check_model(model)
    serialised: bytes = model.SerializeToString()
    return serialised


def _radial(regressor: RadialBasis, step: Any, found: str) -> str:
    """exp(−|x − c|²/2s²), with the square expanded, so that it is one matrix product."""
    spread = 2.0 * regressor._spread**2
    centre, coefficient = regressor._centre, regressor._coefficient
    square = step("MatMul", step("Mul", found, found), ones=np.ones((centre.shape[1], 1)) / spread)
    cross = step("MatMul", found, centre=2.0 * centre.T / spread)
    exponent = step("Sub", step("Sub", cross, square), own=(centre**2).sum(axis=1) / spread)
    weighted = step("MatMul", step("Exp", exponent), coefficient=coefficient[:-1])
    result: str = step("Add", weighted, bias=coefficient[-1])
    return result
