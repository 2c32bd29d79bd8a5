"""A contact model of another program needs no more than when it was tried, or is refused."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import NodeProto, TensorProto, numpy_helper
from onnx.helper import make_graph, make_model, make_node, make_opsetid, make_tensor_value_info

from fmfts.contact import ContactModel, ModelError, operators
from fmfts.contact.contract import IR_VERSION, OPSET, WEIGHTS_KEY
from fmfts.contact.inference import POSE
from fmfts.contact.operators import DOCUMENT, require_even
from fmfts.contact.seal import unsealed
from fmfts.contact.session import session_of
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.pad import Pad

DEFAULT = onnx.load_from_string(unsealed(DEFAULT_PATH.read_bytes()))
CONSTANTS: dict[str, Any] = {
    "all": np.array([0, 1]), "one": np.array([1]), "two": np.array([2]), "zero": np.array([0]), "many": np.float32(3e8),
    "columns": np.ones((POSE, 3), np.float32), "rows": np.ones((1, 1, POSE), np.float32), "low": np.float32(-1.0),
}  # fmt: skip
# The answer follows from `offset`.
REST = (
    make_node("MatMul", ["pose", "columns"], ["summed"]),
    make_node("Add", ["summed", "offset"], ["contact"]),
    make_node("Unsqueeze", ["contact", "two"], ["high"]),
    make_node("Mul", ["high", "rows"], ["jacobian"]),
)
# An integer that is 0 at the pose 0.
COUNT = (
    make_node("ReduceSum", ["pose", "one"], ["total"]),
    make_node("Mul", ["total", "many"], ["large"]),
    make_node("Abs", ["large"], ["positive"]),
    make_node("ReduceMax", ["positive"], ["largest"], keepdims=0),
    make_node("Reshape", ["largest", "one"], ["number"]),
    make_node("Cast", ["number"], ["count"], to=TensorProto.INT64),
)


def model(*nodes: NodeProto) -> onnx.ModelProto:
    graph = make_graph(
        [*nodes, *REST],
        "own",
        [make_tensor_value_info("pose", TensorProto.FLOAT, ["N", POSE])],
        [
            make_tensor_value_info("contact", TensorProto.FLOAT, ["N", 3]),
            make_tensor_value_info("jacobian", TensorProto.FLOAT, ["N", 3, POSE]),
        ],
        [numpy_helper.from_array(value, name) for name, value in CONSTANTS.items()],
    )
    proto = make_model(graph, opset_imports=[make_opsetid("", OPSET)], ir_version=IR_VERSION)
    proto.metadata_props.extend(entry for entry in DEFAULT.metadata_props if entry.key != WEIGHTS_KEY)
    return proto


def nothing(name: str) -> NodeProto:
    """`offset`: the sum of a tensor."""
    return make_node("ReduceSum", [name], ["offset"], keepdims=0)


def lying(*more: NodeProto) -> onnx.ModelProto:
    """At a pose whose components sum to 10 it asks for 12 GB, in less than a kilobyte without its metadata."""
    return model(*COUNT, make_node("ConstantOfShape", ["count"], ["zeros"]), nothing("zeros"), *more)


def load(folder: Path, pad: Pad, proto: onnx.ModelProto) -> ContactModel:
    path = folder / "own.onnx"
    path.write_bytes(proto.SerializeToString())
    return ContactModel.load(str(path), pad)


def test_model_that_needs_more_for_some_poses_is_refused(tmp_path: Path, pad: Pad) -> None:
    proto = lying()
    for tensor in proto.graph.initializer:  # neither 0 nor rest reveals it
        if tensor.name == "many":
            tensor.CopyFrom(numpy_helper.from_array(np.float32(1e-9), "many"))
    with pytest.raises(ModelError, match="index of its operator 'ConstantOfShape' depends on the pose"):
        load(tmp_path, pad, proto)


@pytest.mark.parametrize(
    ("node", "operator"),
    [
        (make_node("Range", ["low", "total", "many"], ["offset"]), "Range"),
        (make_node("NonZero", ["pose"], ["offset"]), "NonZero"),
        (make_node("Tanh", ["pose"], ["offset"], domain="other"), "Tanh"),
        (make_node("If", ["pose"], ["offset"], then_branch=DEFAULT.graph, else_branch=DEFAULT.graph), "If"),
        (make_node("Loop", ["count", "", "pose"], ["offset"], body=DEFAULT.graph), "Loop"),
    ],
    ids=["range", "nonzero", "other domain", "if", "loop"],
)
def test_unlisted_operator_is_refused_by_name(tmp_path: Path, pad: Pad, node: NodeProto, operator: str) -> None:
    with pytest.raises(ModelError, match=f"it uses the operator '{operator}', which is not one of"):
        load(tmp_path, pad, model(*COUNT, node))


@pytest.mark.parametrize("operator", ["Reshape", "Expand", "Tile", "Slice", "Gather", "Unsqueeze", "Squeeze"])
def test_shape_that_depends_on_the_pose_is_refused(operator: str) -> None:
    inputs = ["pose", "zero", "count", "one"] if operator == "Slice" else ["pose", "count"]
    node = make_node(operator, inputs, ["some"])
    with pytest.raises(ValueError, match=f"operator '{operator}' depends on the pose"):
        require_even(model(*COUNT, node, nothing("some")).SerializeToString())


def test_shapes_that_follow_from_constants_are_loaded(tmp_path: Path, pad: Pad) -> None:
    """As exporters write them, with the number of poses kept variable."""
    zeros = (
        make_node("Shape", ["pose"], ["shape"]),
        make_node("Slice", ["shape", "zero", "one"], ["poses"]),
        make_node("Constant", [], ["three"], value=numpy_helper.from_array(np.array([3]))),
        make_node("Concat", ["poses", "three"], ["wanted"], axis=0),
        make_node("ConstantOfShape", ["wanted"], ["offset"]),
    )
    loaded = load(tmp_path, pad, model(*zeros))
    assert loaded.inference.by == "onnxruntime"
    np.testing.assert_allclose(loaded._infer(np.arange(6.0))[0], 15.0)


def test_model_that_needs_most_for_a_single_pose_is_refused(tmp_path: Path, pad: Pad) -> None:
    """512 MB for one, as in the daemon; 30 MB for each if they are evaluated together."""
    nodes = (
        make_node("Shape", ["pose"], ["shape"]),
        make_node("Slice", ["shape", "zero", "one"], ["poses"]),
        make_node("Div", ["half_gigabyte", "poses"], ["wanted"]),
        make_node("ConstantOfShape", ["wanted"], ["zeros"]),
        nothing("zeros"),
    )
    proto = model(*nodes)
    proto.graph.initializer.append(numpy_helper.from_array(np.array([1 << 27]), "half_gigabyte"))
    with pytest.raises(ModelError, match="within a pad's means"):
        load(tmp_path, pad, proto)


def test_size_hidden_in_a_first_of_two_graphs_is_refused() -> None:
    """Protobuf merges a part that comes twice: onnxruntime sees the nodes of both."""
    whole = lying()
    rest, hidden = onnx.ModelProto(), onnx.ModelProto()
    rest.CopyFrom(whole)
    hidden.graph.node.extend(whole.graph.node[:-1])
    del rest.graph.node[:-1]
    content = hidden.SerializeToString() + rest.SerializeToString()
    assert onnx.load_from_string(content) == whole
    with pytest.raises(ValueError, match="ConstantOfShape"):
        require_even(content)


def test_value_set_by_a_node_is_no_constant() -> None:
    proto = model(make_node("Expand", ["pose", "one"], ["some"]), nothing("some"))
    require_even(proto.SerializeToString())
    proto.graph.input.append(make_tensor_value_info("one", TensorProto.INT64, [1]))
    with pytest.raises(ValueError, match="Expand"):
        require_even(proto.SerializeToString())


def test_model_with_functions_of_its_own_is_refused() -> None:
    proto = model(make_node("Identity", ["low"], ["offset"]))
    proto.functions.add(name="Identity")
    with pytest.raises(ValueError, match="operators of its own"):
        require_even(proto.SerializeToString())


def test_evaluated_model_is_the_checked_one() -> None:
    """Another reader may find a node where this one sees an unknown field: such files are not passed on."""
    proto = model(make_node("Identity", ["low"], ["offset"]))
    unknown = b"\xfa\x7f\x02no"  # field 2047
    assert require_even(proto.SerializeToString() + unknown) == proto.SerializeToString()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (DEFAULT.SerializeToString(), "pip install 'fmfts[calibrate]'"),
        (b"no model", "ValueError: it is not an ONNX file: give one that `calibrate` wrote"),
        (b"", "ValueError: it is not an ONNX file: give one"),
    ],
    ids=["model", "text", "nothing"],
)
def test_missing_onnx_package_says_what_to_install(tmp_path: Path, content: bytes, said: str) -> None:
    hidden = tmp_path / "onnx.py"
    hidden.write_text("raise ImportError\n")
    asked = "import sys; sys.path.insert(0, sys.argv[1]); from fmfts.contact import operators as o; "
    asked += "o.require_even(sys.stdin.buffer.read())"
    ended = subprocess.run([sys.executable, "-c", asked, tmp_path], input=content, capture_output=True, check=False)
    assert said in ended.stderr.decode()


def test_model_in_another_format_is_not_loaded() -> None:
    """onnxruntime's own format begins so, and its operators were never checked."""
    with pytest.raises(ValueError, match=r"[Pp]rotobuf"):
        session_of(b"\x20\x00\x00\x00ORTM" + bytes(100))


def test_manual_and_refusal_name_the_file_that_lists_the_operators() -> None:
    root = Path(__file__).parents[2]
    manual = (root / "docs" / "calibration.md").read_text()
    (file, *lists) = re.findall(r"`([^`]*)`", manual.split("only the operators that")[1].split("if their")[0])
    assert (root / file).read_text().count("one of {DOCUMENT}") == 1
    assert f"those in {file.removeprefix('daemon/')}" == DOCUMENT
    assert lists == ["PLAIN", "SIZED_FROM"]
    assert all(hasattr(operators, name) for name in lists)
