"""Trained layers → one ONNX graph with the contact and its Jacobian.

Written node by node: exporters return wrong shapes for several outputs, and none gives derivatives.
"""

from __future__ import annotations

import msgspec
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from fmfts.calibrate.network import DIRECTION_GAIN, SOFTENING, ContactNetwork
from fmfts.contact.contract import IR_VERSION, METADATA_KEY, OPSET, RESPONSE_KEY, Facts, pack_response
from fmfts.contact.response import Response
from fmfts.pad import Array

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


def export(network: ContactNetwork, facts: Facts, response: Response | None) -> bytes:
    """The serialised model; raises onnx.checker.ValidationError if it is not a valid one.

    response: what the model was trained on, so that `refine` can use it; None leaves it out.
    """
    outputs = len(network.layers.bias[-1])
    graph = helper.make_graph(
        _nodes(FORWARD + BACKWARD),
        "contact",
        [helper.make_tensor_value_info("pose", TensorProto.FLOAT, ["N", 6])],
        [
            helper.make_tensor_value_info("contact", TensorProto.FLOAT, ["N", outputs]),
            helper.make_tensor_value_info("jacobian", TensorProto.FLOAT, ["N", outputs, 6]),
        ],
        [_tensor(name, value) for name, value in _constants(network).items()]
        + [
            numpy_helper.from_array(np.array([axis], dtype=np.int64), name)
            for name, axis in {"last": 1, "middle": 1, "last3": 2}.items()
        ],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="fmfts"
    )
    properties = {METADATA_KEY: msgspec.json.encode(facts).decode()}
    if response is not None:
        properties[RESPONSE_KEY] = pack_response(response)
    helper.set_model_props(model, properties)
    onnx.checker.check_model(model, full_check=True)
    serialised: bytes = model.SerializeToString(deterministic=True)
    return serialised


def _constants(network: ContactNetwork) -> dict[str, Array]:
    by_scale = np.zeros((6, 5))  # the axis's last component follows from the others
    by_scale[:5] = np.diag(1.0 / network.scale)
    w1, w2, w3 = network.layers.weight
    b1, b2, b3 = network.layers.bias
    w1 = w1 * np.repeat([1.0, DIRECTION_GAIN], 5)[:, None]
    return {
        "rest": network.rest_pose[None], "by_scale": by_scale, "by_scale_t": by_scale.T,
        "softening": np.array(SOFTENING**2), "one": np.array(1.0),
        "w1": w1, "w2": w2, "w3": w3, "b1": b1, "b2": b2, "b3": b3,
        "w1_t_of_s": w1.T[:, :5], "w1_t_of_u": w1.T[:, 5:], "w2_t": w2.T, "w3_t": w3.T[None],
    }  # fmt: skip


def _nodes(program: str) -> list[onnx.NodeProto]:
    nodes = []
    for line in program.split("\n"):
        if not line:
            continue
        result, call = line.split(" = ")
        operation, inputs = call.rstrip(")").split("(")
        node = helper.make_node(operation, inputs.split(", "), [result])
        if operation == "Concat":
            node.attribute.append(helper.make_attribute("axis", 1))
        nodes.append(node)
    return nodes


def _tensor(name: str, value: Array) -> onnx.TensorProto:
    return numpy_helper.from_array(np.ascontiguousarray(value, dtype=np.float32), name)
