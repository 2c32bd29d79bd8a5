"""Writes trained layers as one ONNX graph with the contact and its Jacobian.

The graph is made node by node, because exporters give wrong shapes for several outputs and no derivatives.
"""

from __future__ import annotations

import msgspec
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from fmfts.contact.contract import (
    INPUT_ORDER,
    IR_VERSION,
    METADATA_KEY,
    OPSET,
    RESPONSE_KEY,
    Facts,
    pack_response,
    pack_weights,
)
from fmfts.contact.response import Response
from fmfts.contact.seal import sealed
from fmfts_calibrate.graph import AXES, CONCAT_AXIS, FEATURES, NODES, SCALED, constants, weights
from fmfts_calibrate.levenberg import Layers
from fmfts_calibrate.network import DIRECTION_GAIN, SOFTENING, ContactNetwork


def export(network: ContactNetwork, facts: Facts, response: Response | None) -> bytes:
    """The serialised model. response: the pad's response, which `refine` needs; None leaves it out.

    Raises onnx.checker.ValidationError for an invalid model.
    """
    outputs = len(network.layers.bias[-1])
    graph = helper.make_graph(
        _nodes(),
        "contact",
        [helper.make_tensor_value_info("pose", TensorProto.FLOAT, ["N", 6])],
        [
            helper.make_tensor_value_info("contact", TensorProto.FLOAT, ["N", outputs]),
            helper.make_tensor_value_info("jacobian", TensorProto.FLOAT, ["N", outputs, 6]),
        ],
        [numpy_helper.from_array(value, name) for name, value in _constants(network).items()]
        + [numpy_helper.from_array(np.array([axis], dtype=np.int64), name) for name, axis in AXES.items()],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="fmfts"
    )
    properties = {METADATA_KEY: msgspec.json.encode(facts).decode()}
    if response is not None:
        properties[RESPONSE_KEY] = pack_response(response)
    helper.set_model_props(model, properties)
    onnx.checker.check_model(model, full_check=True)
    return sealed(model.SerializeToString(deterministic=True), packed_weights(network))


def packed_weights(network: ContactNetwork) -> str:
    """The weights that follow the model, for network.c."""
    return pack_weights(weights(_constants(network)))


def network_of(vector: NDArray[np.float32]) -> ContactNetwork:
    """The network of the weights that `packed_weights` packs (network.h)."""
    hidden, outputs, at = int(vector[0]), int(vector[1]), 3
    parts = []
    for shape in (
        *((len(INPUT_ORDER),), (len(INPUT_ORDER), SCALED)),
        *((FEATURES, hidden), (hidden,), (hidden, hidden), (hidden,), (hidden, outputs), (outputs,)),
    ):
        size = int(np.prod(shape))
        parts.append(vector[at : at + size].astype(float).reshape(shape))
        at += size
    rest_pose, by_scale, w1, b1, w2, b2, w3, b3 = parts
    w1 = w1 / np.repeat([1.0, DIRECTION_GAIN], SCALED)[:, None]
    return ContactNetwork(rest_pose, 1.0 / np.diagonal(by_scale), Layers((w1, w2, w3), (b1, b2, b3)))


def _constants(network: ContactNetwork) -> dict[str, NDArray[np.float32]]:
    by_scale = np.zeros((6, SCALED))
    by_scale[:SCALED] = np.diag(1.0 / network.scale)
    w1, w2, w3 = network.layers.weight
    w1 = w1 * np.repeat([1.0, DIRECTION_GAIN], SCALED)[:, None]
    return constants(network.rest_pose, by_scale, SOFTENING**2, (w1, w2, w3), network.layers.bias)


def _nodes() -> list[onnx.NodeProto]:
    nodes = []
    for operation, inputs, output in NODES:
        node = helper.make_node(operation, inputs, [output])
        if operation == "Concat":
            node.attribute.append(helper.make_attribute("axis", CONCAT_AXIS))
        nodes.append(node)
    return nodes
