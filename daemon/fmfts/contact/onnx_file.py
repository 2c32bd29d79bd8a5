"""Reads the versions, weights and nodes of an ONNX file. onnxruntime does not give them, and the onnx package is no
runtime dependency. Field numbers are those of onnx.proto."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.graph import Node
from fmfts.contact.protobuf import Budget, MalformedError, Message

Constant = NDArray[Any]  # float32 or int64

FLOAT, INT64 = 1, 7  # TensorProto.DataType
ELEMENT: dict[int, np.dtype[Any]] = {FLOAT: np.dtype("<f4"), INT64: np.dtype("<i8")}
DEFAULT_DOMAIN = ("", "ai.onnx")
EXTERNAL = 'weights in other files ("external data") are not read: save it as one file'
# By kind of message: the fields that may contain tensors, and what kind of message they hold.
INSIDE = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "function": {7: "node", 11: "attribute"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
}
EXTERNAL_DATA, DATA_LOCATION = 13, 14  # of a tensor
DEEPEST = 3  # graphs within attributes of graphs
MOST_DIMENSIONS = 8  # of a tensor: the product of as many as a file can name takes minutes


class Port(NamedTuple):
    """An input or output of a graph. shape: the size of each dimension, or its name if the size is variable."""

    name: str
    element: int
    shape: tuple[str | int, ...]


class Graph(NamedTuple):
    """nodes: each with its axis, if a Concat; None if a node has other attributes, several outputs or another domain.
    constants: those of float32 and int64."""

    nodes: tuple[tuple[Node, int | None], ...] | None
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    constants: dict[str, Constant]


class OnnxFile(NamedTuple):
    """opset: version of the default operator set."""

    ir_version: int
    opset: int
    metadata: dict[str, str]
    graph: Graph


def parse(content: bytes) -> OnnxFile:
    """ValueError if it is no ONNX model, or has weights in other files: these are not opened, because the hash of the
    model's file must cover all of the model."""
    try:
        budget = Budget()
        _require_whole("model", content, budget)
        model = Message(content, budget)
        return OnnxFile(
            model.integer(1),
            max((each.integer(2) for each in model.messages(8) if each.text(1) in DEFAULT_DOMAIN), default=0),
            {each.text(1): each.text(2) for each in model.messages(14)},
            _graph(model.message(7)),
        )
    except MalformedError as error:
        raise ValueError(f"it is not an ONNX file, or a truncated one ({error})") from error


def _graph(graph: Message) -> Graph:
    nodes = [_node(each) for each in graph.messages(1)]
    plain = tuple(node for node in nodes if node is not None)
    return Graph(
        plain if len(plain) == len(nodes) else None,
        tuple(_port(each) for each in graph.messages(11)),
        tuple(_port(each) for each in graph.messages(12)),
        {each.text(8): value for each in graph.messages(5) if (value := _constant(each)) is not None},
    )


def _node(node: Message) -> tuple[Node, int | None] | None:
    outputs, attributes = node.texts(2), {each.text(1): each.integer(3) for each in node.messages(5)}
    if len(outputs) != 1 or node.text(7) not in DEFAULT_DOMAIN or attributes.keys() - {"axis"}:
        return None
    return Node(node.text(4), tuple(node.texts(1)), outputs[0]), attributes.get("axis")


def _port(value: Message) -> Port:
    tensor = value.message(2).message(1)
    dimensions = tensor.message(2).messages(1)
    shape = tuple(each.integer(1) if 1 in each else each.text(2) for each in dimensions)
    return Port(value.text(1), tensor.integer(1), shape)


def _constant(tensor: Message) -> Constant | None:
    """The value of a tensor; None if it has another type or is not written as raw data."""
    element, shape, raw = ELEMENT.get(tensor.integer(2)), tensor.integers(1), tensor.part(9)
    if (
        element is None
        or len(shape) > MOST_DIMENSIONS
        or max(shape, default=0) > len(raw)
        or len(raw) != element.itemsize * math.prod(shape)
    ):
        return None
    return np.frombuffer(raw, element).reshape(shape)


def _require_whole(kind: str, content: bytes, budget: Budget, depth: int = 0) -> None:
    """ValueError if a tensor anywhere in the message has its data in another file."""
    if depth > DEEPEST:
        raise ValueError("its graphs are nested deeper than those of any contact model")
    message = Message(content, budget)
    if kind == "tensor" and (EXTERNAL_DATA in message or any(message.integers(DATA_LOCATION))):
        raise ValueError(EXTERNAL)
    for number, inner in INSIDE.get(kind, {}).items():
        for part in message.parts(number):
            _require_whole(inner, part, budget, depth + (inner == "graph"))
