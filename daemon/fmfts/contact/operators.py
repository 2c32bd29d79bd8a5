"""Refuses models whose tensors are larger for some poses than for others: a test with a few poses bounds time and
memory only if no size depends on the pose.

It needs the onnx package. Models of `calibrate` need no check: network.c evaluates them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fmfts.contact.contract import EXTERNAL, IR_VERSION, OPSET

Part = Any  # part of a model, as the onnx package reads it

BEGINNING = bytes([1 << 3])  # protobuf's key of field 1, a number: ir_version, which every writer puts first
GIVE = "give one that `calibrate` wrote, or a shipped name"
DEFAULT_DOMAIN = ("", "ai.onnx")
DOCUMENT = "those in fmfts/contact/operators.py"
# Operators whose outputs' sizes follow from the sizes of their inputs.
PLAIN = frozenset({
    "Abs", "Acos", "Add", "And", "Asin", "Atan", "BatchNormalization", "Cast", "Ceil", "Celu", "Clip", "Concat",
    "Constant", "Cos", "Cosh", "Div", "Einsum", "Elu", "Equal", "Erf", "Exp", "Flatten", "Floor", "Gemm", "Greater",
    "GreaterOrEqual", "HardSigmoid", "HardSwish", "Identity", "LayerNormalization", "LeakyRelu", "Less",
    "LessOrEqual", "Log", "LogSoftmax", "MatMul", "Max", "Mean", "Min", "Mul", "Neg", "Not", "Or", "PRelu", "Pow",
    "Reciprocal", "ReduceL2", "ReduceMax", "ReduceMean", "ReduceMin", "ReduceProd", "ReduceSumSquare", "Relu",
    "Round", "Selu", "Shape", "Sigmoid", "Sign", "Sin", "Sinh", "Size", "Softmax", "Softplus", "Softsign", "Sqrt",
    "Sub", "Sum", "Tan", "Tanh", "Transpose", "Where", "Xor",
})  # fmt: skip
# The inputs from this one on are indices, axes or shapes: these must be the same for every pose.
SIZED_FROM = {
    "ConstantOfShape": 0, "Expand": 1, "Gather": 1, "ReduceSum": 1, "Reshape": 1, "Slice": 1, "Split": 1, "Squeeze": 1,
    "Tile": 1, "Unsqueeze": 1,
}  # fmt: skip
OF_SIZES = frozenset({"Shape", "Size"})  # operators whose output is the same for every pose and input


def require_even(content: bytes) -> bytes:
    """The model after the check. ValueError names what is wrong, or the operator if a tensor may have another size
    for another pose."""
    try:
        import onnx
        from google.protobuf.message import DecodeError  # type: ignore[import-untyped]
    except ImportError:
        if not content.startswith(BEGINNING):
            raise ValueError(f"it is not an ONNX file: {GIVE}") from None
        raise ValueError(
            "`calibrate` did not write it, and the package that lists its operators is not installed: "
            "pip install 'fmfts[calibrate]'"
        ) from None
    try:
        model = onnx.load_from_string(content)
    except DecodeError:
        raise ValueError(f"it is not an ONNX file, or a truncated one: {GIVE}") from None
    _require_known(model)
    graph = model.graph
    made = {name for node in graph.node for name in node.output}
    given = {each.name for each in graph.input}
    fixed = {tensor.name for tensor in graph.initializer} - made - given | {""}  # "": left out
    for node in graph.node:
        operator, inputs = node.op_type, node.input
        if node.domain not in DEFAULT_DOMAIN or not (operator in PLAIN or operator in SIZED_FROM):
            raise ValueError(f"it uses the operator {operator!r}, which is not one of {DOCUMENT}")
        if not fixed.issuperset(inputs[SIZED_FROM.get(operator, len(inputs)) :]):
            raise ValueError(f"a shape, axis or index of its operator {operator!r} depends on the pose")
        if operator in OF_SIZES or fixed.issuperset(inputs):
            fixed.update(node.output)
    model.DiscardUnknownFields()
    looked_at: bytes = model.SerializeToString()
    return looked_at


def _require_known(model: Part) -> None:
    opset = max((each.version for each in model.opset_import if each.domain in DEFAULT_DOMAIN), default=0)
    if (model.ir_version, opset) != (IR_VERSION, OPSET):
        raise ValueError(f"it has IR version {model.ir_version} and opset {opset}, not {IR_VERSION} and {OPSET}")
    if model.functions:
        raise ValueError("it defines operators of its own (functions): export it without")
    if any(tensor.external_data or tensor.data_location for tensor in _tensors(model)):
        raise ValueError(EXTERNAL)


def _tensors(part: Part) -> Iterator[Part]:
    """All nodes, with those of nested graphs."""
    for field, value in part.ListFields():
        if field.message_type is not None:
            for inner in [value] if hasattr(value, "ListFields") else value:
                if field.message_type.name == "TensorProto":
                    yield inner
                yield from _tensors(inner)
