"""Refuses models whose tensors are larger for some poses than for others: evaluating a few poses first tells what every
pose takes only where no size depends on the pose. Field numbers are those of onnx.proto."""

from __future__ import annotations

from fmfts.contact.onnx_file import DEFAULT_DOMAIN
from fmfts.contact.protobuf import Budget, Message

DOCUMENT = "those that docs/calibration.md lists"
# The sizes of what they give follow from the sizes of what they get.
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
OF_SIZES = frozenset({"Shape", "Size"})  # what they give is the same for every pose, whatever they get


def require_even(content: bytes) -> None:
    """ValueError with the operator's name if a tensor of the ONNX model may have another size for another pose."""
    model = Message(content, Budget())
    if 25 in model:
        raise ValueError("it defines operators of its own (functions): export it without")
    graphs = model.messages(7)  # protobuf merges several into one
    nodes = [node for graph in graphs for node in graph.messages(1)]
    made = {name for node in nodes for name in node.texts(2)}
    given = {each.text(1) for graph in graphs for each in graph.messages(11)}
    fixed = {tensor.text(8) for graph in graphs for tensor in graph.messages(5)} - made - given | {""}  # "": left out
    for node in nodes:
        operator, inputs = node.text(4), node.texts(1)
        if node.text(7) not in DEFAULT_DOMAIN or not (operator in PLAIN or operator in SIZED_FROM):
            raise ValueError(f"it uses the operator {operator!r}, which is not one of {DOCUMENT}")
        if not fixed.issuperset(inputs[SIZED_FROM.get(operator, len(inputs)) :]):
            raise ValueError(f"a shape, axis or index of its operator {operator!r} depends on the pose")
        if operator in OF_SIZES or fixed.issuperset(inputs):
            fixed.update(node.texts(2))
