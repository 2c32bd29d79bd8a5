"""Recognises the graph of graph.py in a model: then our own network can evaluate it instead of onnxruntime."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.contract import SHEAR_OUTPUT_ORDER
from fmfts.contact.graph import AXES, CONCAT_AXIS, FEATURES, INPUT, NODES, OUTPUTS, SCALED, constants
from fmfts.contact.inference import LARGEST_HIDDEN, POSE
from fmfts.contact.onnx_file import FLOAT, Constant, Graph

Vector = NDArray[np.float32]
MOST_OUTPUTS = len(SHEAR_OUTPUT_ORDER)
PLAN = tuple((node, CONCAT_AXIS if node.operation == "Concat" else None) for node in NODES)


def network_of(graph: Graph) -> Vector | None:
    """The weights in `graph`, as network.h describes them; None unless all is as `calibrate` writes it."""
    found = graph.constants
    shapes = _shapes(found)
    if shapes is None or graph.nodes != PLAN or not _has_ports(graph, outputs=shapes["b3"][0]):
        return None
    if found.keys() != shapes.keys() | {"by_scale_t", "one", "w1_t_of_s", "w1_t_of_u", "w2_t", "w3_t"} | AXES.keys():
        return None
    written = constants(
        found["rest"][0],
        found["by_scale"],
        float(found["softening"][0]),
        [found[name] for name in ("w1", "w2", "w3")],
        [found[name] for name in ("b1", "b2", "b3")],
    )
    axes = {name: np.array([axis]) for name, axis in AXES.items()}
    if not all(np.array_equal(found[name], value) for name, value in (written | axes).items()):
        return None
    hidden, outputs = shapes["w3"]
    order = ("rest", "by_scale", "w1", "b1", "w2", "b2", "w3", "b3")
    head = np.array([hidden, outputs, written["softening"][0]], dtype=np.float32)
    return np.concatenate([head, *(written[name].ravel() for name in order)])


def _shapes(found: dict[str, Constant]) -> dict[str, tuple[int, ...]] | None:
    """Shapes of the constants from which the others follow; None if one is missing or has a wrong type or shape."""
    if "w3" not in found or found["w3"].ndim != 2:
        return None
    hidden, outputs = found["w3"].shape
    if not (0 < hidden <= LARGEST_HIDDEN and 0 < outputs <= MOST_OUTPUTS):
        return None
    shapes = {
        "rest": (1, POSE), "by_scale": (POSE, SCALED), "softening": (1,),
        "w1": (FEATURES, hidden), "b1": (hidden,), "w2": (hidden, hidden), "b2": (hidden,),
        "w3": (hidden, outputs), "b3": (outputs,),
    }  # fmt: skip
    fits = all(
        name in found and found[name].shape == shape and found[name].dtype == np.float32
        for name, shape in shapes.items()
    )
    return shapes if fits else None


def _has_ports(graph: Graph, outputs: int) -> bool:
    """Whether inputs and outputs are those of graph.py: float32, for any number of poses."""
    wanted = {INPUT: (POSE,), OUTPUTS[0]: (outputs,), OUTPUTS[1]: (outputs, POSE)}
    ports = (*graph.inputs, *graph.outputs)
    return [port.name for port in ports] == list(wanted) and all(
        port.element == FLOAT and isinstance(port.shape[0], str) and port.shape[1:] == wanted[port.name]
        for port in ports
    )
