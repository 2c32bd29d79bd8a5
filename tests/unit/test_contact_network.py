"""The compiled contact network: what it is read from, when it is used, and that it answers as onnxruntime does."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from onnx import TensorProto, helper
from pad_frames import frames_of
from test_pipeline import config_of, pipeline_of

from examples import examples
from fmfts.contact import ContactModel, ModelError, comparison, recognition, verified
from fmfts.contact.comparison import NotComparedError, answers, answers_of_onnxruntime, difference, poses_of
from fmfts.contact.inference import _contact
from fmfts.contact.onnx_file import parse
from fmfts.contact.recognition import network_of
from fmfts.contact.seal import unsealed
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.pad import Pad
from fmfts.simulation.baseline import simulated_baseline

CONTENT = unsealed(DEFAULT_PATH.read_bytes())
Edit = Callable[[onnx.ModelProto], None]


@pytest.fixture(autouse=True)
def _ask_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verified, "_differences", {})


def edited(edit: Edit) -> bytes:
    proto = onnx.load_from_string(CONTENT)
    edit(proto)
    content: bytes = proto.SerializeToString()
    return content


def load(folder: Path, pad: Pad, content: bytes) -> ContactModel:
    path = folder / "edited.onnx"
    path.write_bytes(content)
    return ContactModel.load(str(path), pad)


# --- reading the file ---


def test_file_says_what_the_onnx_package_finds_in_it() -> None:
    proto, parsed = onnx.load_from_string(CONTENT), parse(CONTENT)
    assert (parsed.ir_version, parsed.opset) == (proto.ir_version, proto.opset_import[0].version)
    assert parsed.metadata == {entry.key: entry.value for entry in proto.metadata_props}
    assert parsed.graph.nodes is not None
    assert [(n.operation, *n.inputs, n.output) for n, _ in parsed.graph.nodes] == [
        (n.op_type, *n.input, *n.output) for n in proto.graph.node
    ]
    for tensor in proto.graph.initializer:
        np.testing.assert_array_equal(parsed.graph.constants[tensor.name], onnx.numpy_helper.to_array(tensor))


@given(st.binary(max_size=200))
def test_any_bytes_are_a_model_or_refused(content: bytes) -> None:
    with_error(content)


@given(st.lists(st.tuples(st.integers(0, len(CONTENT) - 1), st.integers(0, 255)), min_size=1, max_size=8))
@examples(60)
def test_spoilt_model_is_read_or_refused(changes: list[tuple[int, int]]) -> None:
    content = bytearray(CONTENT)
    for place, value in changes:
        content[place] = value
    with_error(bytes(content))


@given(st.integers(0, len(CONTENT) - 1), st.binary(max_size=12))
@examples(60)
def test_model_with_bytes_put_in_is_read_or_refused(place: int, added: bytes) -> None:
    with_error(CONTENT[:place] + added + CONTENT[place:])


def with_error(content: bytes) -> None:
    """No other error than ValueError, which the loader turns into a sentence; what is read can be looked at."""
    try:
        parsed = parse(content)
    except ValueError:
        return
    network_of(parsed.graph)


def test_the_word_location_alone_is_no_external_data(tmp_path: Path, pad: Pad) -> None:
    model = load(tmp_path, pad, edited(lambda proto: proto.metadata_props.add(key="note", value="location")))
    assert model.inference.by == "compiled"


def external(tensor: onnx.TensorProto) -> onnx.TensorProto:
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    return tensor


def in_a_branch(proto: onnx.ModelProto) -> None:
    """A tensor of a graph within a node's attribute."""
    hidden = external(helper.make_tensor("hidden", TensorProto.FLOAT, [1], [0.0]))
    branch = helper.make_graph([helper.make_node("Constant", [], ["c"], value=hidden)], "branch", [], [])
    proto.graph.node.append(helper.make_node("If", ["one"], ["c"], then_branch=branch, else_branch=branch))


@pytest.mark.parametrize("edit", [lambda proto: external(proto.graph.initializer[0]), in_a_branch])
def test_external_data_is_refused_wherever_it_hides(tmp_path: Path, pad: Pad, edit: Edit) -> None:
    with pytest.raises(ModelError, match="external data"):
        load(tmp_path, pad, edited(edit))


def test_graphs_without_end_are_refused() -> None:
    with pytest.raises(ValueError, match="nested deeper"):
        parse(nested(60))


def varint(value: int) -> bytes:
    if value < 128:
        return bytes([value])
    return bytes([value & 127 | 128]) + varint(value >> 7)


def field(number: int, content: bytes) -> bytes:
    return varint(number << 3 | 2) + varint(len(content)) + content


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(field(7, field(5, field(1, b"\xff\xff\xff\xff\x0f" * 200_000))), id="dimensions"),
        pytest.param(field(7, field(5, b"".join(varint(n << 3) + b"\0" for n in range(1, 200_000)))), id="numbers"),
        pytest.param(field(7, field(1, b"") * 200_000), id="nodes"),
        pytest.param(field(7, field(1, field(5, b"") * 200_000)), id="attributes"),
        pytest.param(field(14, b"") * 200_000, id="metadata"),
    ],
)
def test_model_of_too_many_parts_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match="more parts than any contact model"):
        parse(content)


def test_shape_of_many_dimensions_is_no_constant() -> None:
    """The product of a million factors takes minutes, and NumPy has no array of so many."""
    tensor = field(1, varint(1) * 90_000) + b"\x10\x01" + field(8, b"w") + field(9, bytes(4))
    assert parse(field(7, field(5, tensor))).graph.constants == {}


def expanding(proto: onnx.ModelProto, elements: int) -> None:
    """The contact's first node sums so many zeros, which take two bytes in the file."""
    node = proto.graph.node
    proto.graph.initializer.append(helper.make_tensor("elements", TensorProto.INT64, [1], [elements]))
    node.insert(0, helper.make_node("ConstantOfShape", ["elements"], ["zeros"]))
    node.insert(1, helper.make_node("ReduceSum", ["zeros"], ["nothing"], keepdims=0))
    node.insert(2, helper.make_node("Sub", ["pose", "nothing"], ["same_pose"]))
    node[3].input[0] = "same_pose"


def test_model_that_needs_much_memory_is_refused_before_it_is_loaded(tmp_path: Path, pad: Pad) -> None:
    small = load(tmp_path, pad, edited(lambda proto: expanding(proto, 1000)))
    assert small.inference.by == "onnxruntime"
    with pytest.raises(ModelError, match="within a pad's means"):
        load(tmp_path, pad, edited(lambda proto: expanding(proto, 1 << 28)))


def nested(depth: int) -> bytes:
    """A model whose graph's node's attribute holds a graph, and so on."""
    content = b""
    for level in range(depth):
        number = (1, 5, 6)[-1 - level % 3]  # attribute in node, node in graph, graph in attribute, outwards
        content = bytes([number << 3 | 2]) + varint(len(content)) + content
    return bytes([7 << 3 | 2]) + varint(len(content)) + content


# --- which evaluates ---


def add_identity(proto: onnx.ModelProto) -> None:
    proto.graph.node.append(helper.make_node("Identity", ["a3"], ["unused"]))


def untranspose(proto: onnx.ModelProto) -> None:
    """The Jacobian is then of another network than the contact."""
    tensor = next(tensor for tensor in proto.graph.initializer if tensor.name == "w2_t")
    weight = onnx.numpy_helper.to_array(tensor).copy()
    weight[3, 4] += 1.0
    tensor.CopyFrom(onnx.numpy_helper.from_array(weight, "w2_t"))


def other_axis(proto: onnx.ModelProto) -> None:
    (concat,) = (node for node in proto.graph.node if node.op_type == "Concat")
    concat.attribute[0].i = -1  # the same axis, said in another way


def rename(proto: onnx.ModelProto) -> None:
    for node in proto.graph.node:
        for names in (node.input, node.output):
            for index, name in enumerate(names):
                if name == "h1":
                    names[index] = "hidden"


@pytest.mark.parametrize("edit", [add_identity, untranspose, other_axis, rename])
def test_any_other_graph_is_left_to_onnxruntime(tmp_path: Path, pad: Pad, edit: Edit) -> None:
    model = load(tmp_path, pad, edited(edit))
    assert model.inference.by == "onnxruntime"
    shipped = ContactModel.load("default", pad)
    pose = shipped.rest_pose - [0.1, 0.0, 0.4, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(model._infer(pose)[0], shipped._infer(pose)[0], atol=1e-4)  # mm, N: float32


def test_network_that_answers_otherwise_is_not_used(
    pad: Pad, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(comparison, "ROUNDING", 2.0**-24)
    model = ContactModel.load("default", pad)
    assert model.inference.by == "onnxruntime"
    assert "is not used" in caplog.text


def test_without_onnxruntime_the_network_serves_and_the_log_says_so(
    pad: Pad, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def none(*_: object) -> None:
        raise NotComparedError("No module named 'onnxruntime'")

    monkeypatch.setattr(comparison, "answers_of_onnxruntime", none)
    with caplog.at_level(logging.WARNING):
        model = ContactModel.load("default", pad)
    assert model.inference.by == "compiled"
    assert "could not be compared with onnxruntime: No module" in caplog.text


def test_process_that_ends_without_an_answer_is_no_answer() -> None:
    with pytest.raises(NotComparedError, match="onnxruntime does not load it"):
        answers_of_onnxruntime(b"no model", np.zeros((1, 6), np.float32), 3)


# --- what it answers ---


def test_it_answers_as_onnxruntime_does_and_repeats_itself(pad: Pad) -> None:
    from fmfts.contact.session import SessionInference  # the other tests run where onnxruntime does not

    model = ContactModel.load("default", pad)
    poses = poses_of(model.facts)
    compiled, session = answers(model.inference, poses), answers(SessionInference(CONTENT), poses)
    largest = np.abs(session).max(axis=0) + np.finfo(np.float32).tiny
    assert (np.abs(compiled - session) <= comparison.ROUNDING * largest).all()
    assert compiled.tobytes() == answers(model.inference, poses).tobytes()


@pytest.mark.parametrize("wrong", ["w2", "b3"])
def test_one_wrong_weight_is_found(pad: Pad, wrong: str) -> None:
    """By a hundredth."""

    def spoil(proto: onnx.ModelProto) -> None:
        tensor = next(tensor for tensor in proto.graph.initializer if tensor.name == wrong)
        weight = onnx.numpy_helper.to_array(tensor).copy()
        weight.ravel()[np.abs(weight).argmax()] *= 1.01
        tensor.CopyFrom(onnx.numpy_helper.from_array(weight, wrong))

    model = ContactModel.load("default", pad)
    said = difference(model.inference, edited(spoil), model.facts)  # type: ignore[arg-type]
    assert said is not None
    assert "differs from onnxruntime's" in said


@given(st.integers(1, 70), st.sampled_from([3, 5]), st.integers(0, 2**32 - 1), st.sampled_from([0.3, 3.0]))
@examples(60)
def test_networks_of_any_size_are_those_of_the_equations(hidden: int, outputs: int, seed: int, size: float) -> None:
    """In double precision; layers up to saturation (size 3). Rounding of 2⁻²⁴ grows by what a layer weighs."""
    random = np.random.default_rng(seed)
    rest, pose, by_scale = random.normal(size=6), random.normal(size=6), np.zeros((6, 5))
    by_scale[:5] = np.diag(random.uniform(0.5, 2.0, 5))
    w1, w2, w3 = (
        random.normal(0.0, size / np.sqrt(shape[0]), shape)
        for shape in ((10, hidden), (hidden, hidden), (hidden, outputs))
    )
    b1, b2, b3 = (random.normal(size=count) for count in (hidden, hidden, outputs))
    parts = [np.array([hidden, outputs, 0.01]), rest, by_scale, w1, b1, w2, b2, w3, b3]
    vector = np.concatenate([part.ravel() for part in parts]).astype(np.float32)
    contact, jacobian = np.zeros(outputs, np.float32), np.zeros(outputs * 6, np.float32)
    _contact.infer(vector.tobytes(), pose.astype(np.float32).data, contact.data, jacobian.data)

    def forward(at: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled = (at - rest) @ by_scale
        features = np.concatenate([scaled, scaled / np.sqrt(scaled @ scaled + 0.01)])
        answer: NDArray[np.float64] = np.tanh(np.tanh(features @ w1 + b1) @ w2 + b2) @ w3 + b3
        return answer

    slope = np.stack([(forward(pose + step) - forward(pose - step)) / 2e-5 for step in np.eye(6) * 1e-5], axis=1)
    weight = (1.0 + size) ** 3
    np.testing.assert_allclose(contact, forward(pose), atol=100 * 2.0**-24 * weight * np.sqrt(hidden))
    np.testing.assert_allclose(
        jacobian.reshape(outputs, 6), slope, atol=1000 * 2.0**-24 * weight * np.sqrt(hidden) * np.abs(by_scale).max()
    )


def test_what_is_no_number_stays_none(pad: Pad) -> None:
    inference = ContactModel.load("default", pad).inference
    inference.pose[:] = [np.nan, 0.0, 12.0, 0.0, 0.0, 1.0]
    inference.run()
    assert np.isnan(inference.contact).all()


def test_vector_of_another_size_is_refused() -> None:
    vector = network_of(parse(CONTENT).graph)
    assert vector is not None
    room = [np.zeros(count, np.float32).data for count in (6, 3, 18)]
    for wrong in (vector[:-1], np.append(vector, np.float32(0.0)), vector[:2], np.full(9, np.nan, np.float32)):
        with pytest.raises(ValueError, match=r"none of a network|expected"):
            _contact.infer(wrong.tobytes(), *room)


def test_model_that_onnxruntime_evaluates_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """To single precision: it sums in another order."""
    config, frames = config_of(3), frames_of(config_of(3), 8.0)[5 * 220 :]
    baseline = simulated_baseline(config)
    pipeline = pipeline_of(config, baseline)
    ours = [pipeline.process(frame) for frame in frames]
    monkeypatch.setattr(recognition, "LARGEST_HIDDEN", 0)
    assert ContactModel.load("default", config.pad()).inference.by == "onnxruntime"
    pipeline = pipeline_of(config, baseline)
    theirs = [pipeline.process(frame) for frame in frames]
    assert any(message.contact for message in ours)
    for one, other in zip(ours, theirs, strict=True):
        assert (one.health, one.contact) == (other.health, other.contact)
        if one.force_n is not None:
            assert other.force_n == pytest.approx(one.force_n, rel=1e-4, abs=1e-6)
            assert other.force_sd_n == pytest.approx(one.force_sd_n, rel=1e-3)
