"""The compiled contact network: its source, when it is used, and that it answers like onnxruntime."""

from __future__ import annotations

import errno
import os
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

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
from fmfts.contact import ContactModel, ModelError, beside, comparison, verified
from fmfts.contact.comparison import answers, poses_of
from fmfts.contact.contract import WEIGHTS_KEY, pack_weights, parse_weights
from fmfts.contact.inference import NetworkInference, _contact
from fmfts.contact.seal import unsealed, with_seal
from fmfts.contact.shipped import DEFAULT_PATH, SHIPPED_PATHS
from fmfts.pad import Pad
from fmfts_calibrate.export import packed_weights
from fmfts_calibrate.levenberg import Layers
from fmfts_calibrate.network import ContactNetwork
from fmfts_simulation.baseline import simulated_baseline

CONTENT = unsealed(DEFAULT_PATH.read_bytes())
Edit = Callable[[onnx.ModelProto], None]


@pytest.fixture(autouse=True)
def _ask_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verified, "_differences", {})
    beside.told.cache_clear()


def edited(edit: Edit) -> bytes:
    proto = onnx.load_from_string(CONTENT)
    edit(proto)
    content: bytes = proto.SerializeToString()
    return content


def without_weights(proto: onnx.ModelProto) -> None:
    """The model as another program writes it."""
    kept = [entry for entry in proto.metadata_props if entry.key != WEIGHTS_KEY]
    proto.ClearField("metadata_props")
    proto.metadata_props.extend(kept)


def load(folder: Path, pad: Pad, content: bytes) -> ContactModel:
    path = folder / "edited.onnx"
    path.write_bytes(content)
    return ContactModel.load(str(path), pad)


# --- reading the file ---


def test_weights_of_the_shipped_models_are_those_of_their_graphs() -> None:
    for path in SHIPPED_PATHS.values():
        proto = onnx.load_from_string(unsealed(path.read_bytes()))
        found = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in proto.graph.initializer}
        order = ("softening", "rest", "by_scale", "w1", "b1", "w2", "b2", "w3", "b3")
        wanted = np.concatenate([np.array(found["w3"].shape, np.float32), *(found[name].ravel() for name in order)])
        weights = parse_weights({entry.key: entry.value for entry in proto.metadata_props})
        assert weights is not None
        np.testing.assert_array_equal(weights, wanted)


@pytest.mark.parametrize(
    "packed",
    ["", "AAAA", "no base64", pack_weights(np.full(9, np.nan, np.float32)), pack_weights(np.full(9, 1e9, np.float32))],
)
def test_weights_of_no_network_are_refused(packed: str) -> None:
    with pytest.raises(ValueError, match=r"base64|padding|number of outputs|multiple"):
        parse_weights({WEIGHTS_KEY: packed})


def test_weights_of_another_number_of_outputs_than_the_graph_are_refused(tmp_path: Path, pad: Pad) -> None:
    def of_five(proto: onnx.ModelProto) -> None:
        five = ContactNetwork(np.zeros(6), np.ones(5), Layers.drawn((10, 2, 2, 5), np.random.default_rng(0)))
        (own,) = (entry for entry in proto.metadata_props if entry.key == WEIGHTS_KEY)
        own.value = packed_weights(five)

    with pytest.raises(ModelError, match="another number of outputs than 5"):
        load(tmp_path, pad, with_seal(edited(of_five)))


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
    content = edited(lambda proto: (without_weights(proto), edit(proto)))
    with pytest.raises(ModelError, match="external data"):
        load(tmp_path, pad, content)


def expanding(proto: onnx.ModelProto, elements: int) -> None:
    """The contact's first node sums so many zeros, which take two bytes in the file."""
    without_weights(proto)
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


# --- which evaluator runs ---


def test_model_without_weights_is_left_to_onnxruntime(tmp_path: Path, pad: Pad) -> None:
    model = load(tmp_path, pad, edited(without_weights))
    assert model.inference.by == "onnxruntime"
    shipped = ContactModel.load("default", pad)
    pose = shipped.rest_pose - [0.1, 0.0, 0.4, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(model._infer(pose)[0], shipped._infer(pose)[0], atol=1e-4)  # mm, N: float32


@pytest.mark.parametrize("wrong", ["w2", "b3"])
def test_graph_with_one_other_weight_is_left_to_onnxruntime(
    tmp_path: Path, pad: Pad, wrong: str, caplog: pytest.LogCaptureFixture
) -> None:
    """By a hundredth."""

    def spoil(proto: onnx.ModelProto) -> None:
        tensor = next(tensor for tensor in proto.graph.initializer if tensor.name == wrong)
        weight = onnx.numpy_helper.to_array(tensor).copy()
        weight.ravel()[np.abs(weight).argmax()] *= 1.01
        tensor.CopyFrom(onnx.numpy_helper.from_array(weight, wrong))

    assert load(tmp_path, pad, with_seal(edited(spoil))).inference.by == "onnxruntime"
    assert "differs from onnxruntime's" in caplog.text


def test_network_that_answers_otherwise_is_not_used(
    pad: Pad, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(comparison, "ROUNDING", 2.0**-24)
    model = ContactModel.load("default", pad)
    assert model.inference.by == "onnxruntime"
    assert "is not used" in caplog.text


@pytest.fixture
def look(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], None]:
    """Sets what the process in which onnxruntime looks at a model does instead."""
    from fmfts.contact import session

    return lambda done: monkeypatch.setattr(session, "tell", lambda content: done())


def test_dead_process_gives_no_answer(look: Callable[[Callable[[], object]], None], pad: Pad) -> None:
    look(lambda: os.kill(os.getpid(), signal.SIGKILL))
    with pytest.raises(ModelError, match="onnxruntime, in a process of its own, ended with -9"):
        ContactModel.load("default", pad)


def test_process_that_hangs_is_ended(
    look: Callable[[Callable[[], object]], None], monkeypatch: pytest.MonkeyPatch, pad: Pad
) -> None:
    forked: list[int] = []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(child := fork()) or child)
    look(signal.pause)
    monkeypatch.setattr(beside, "LONGEST_S", 0.1)
    with pytest.raises(ModelError, match="onnxruntime looks at it did not end: TimeoutError"):
        ContactModel.load("default", pad)
    with pytest.raises(ProcessLookupError):
        os.kill(forked[0], 0)


ORPHANED = """
import os, time
from fmfts.contact import beside, session

def look(content):
    print("it looks", flush=True)
    time.sleep(60)
    os.write(1, b"it outlived the daemon")

session.tell, beside.LONGEST_S = look, 600.0
beside.told(b"a model")
"""


def test_killed_daemon_leaves_no_process() -> None:
    with subprocess.Popen([sys.executable, "-c", ORPHANED], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"it looks\n"
        process.kill()
        assert process.stdout.read() == b""  # both have ended


def test_other_process_holds_nothing_of_the_daemon(look: Callable[[Callable[[], object]], None], pad: Pad) -> None:
    """A restarted daemon could not lock its bus, nor listen, while another process held the first one's files."""

    def list_files() -> None:
        links = [f"/proc/self/fd/{each}" for each in os.listdir("/proc/self/fd") if int(each) > 2]
        names = sorted(os.readlink(link).partition(":[")[0] for link in links if os.path.exists(link))
        raise ValueError(" ".join(names))

    look(list_files)
    with socket.create_server(("127.0.0.1", 0)), pytest.raises(ModelError) as error:
        ContactModel.load("default", pad)
    assert "default.onnx: /memfd:answer (deleted) pipe; " in str(error.value)


def test_other_process_ends_itself_when_the_daemon_does_not(
    look: Callable[[Callable[[], object]], None], pad: Pad
) -> None:
    def stay() -> None:
        if 0 < signal.alarm(1) <= beside.LONGEST_S + 1:
            signal.pause()

    look(stay)
    before = signal.signal(signal.SIGALRM, signal.SIG_IGN)
    try:
        with pytest.raises(ModelError, match=f"ended with -{signal.SIGALRM}"):
            ContactModel.load("default", pad)
    finally:
        signal.signal(signal.SIGALRM, before)


def test_model_is_read_by_a_process_with_many_files(pad: Pad) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, 2000), hard), hard))
    with ExitStack() as files:
        files.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        while files.enter_context(open(os.devnull)).fileno() < 1024:  # where select(2) ends
            pass
        assert ContactModel.load("default", pad).inference.by == "compiled"


def test_refused_fork_is_named(monkeypatch: pytest.MonkeyPatch, pad: Pad) -> None:
    monkeypatch.setattr(os, "fork", raising(BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))))
    with pytest.raises(ModelError, match=r"no process could be forked in which onnxruntime looks at it: Resource temp"):
        ContactModel.load("default", pad)


@pytest.mark.parametrize("refused", ["memfd_create", "pipe"])
def test_process_that_may_open_no_more_files_says_so(monkeypatch: pytest.MonkeyPatch, pad: Pad, refused: str) -> None:
    before = len(os.listdir("/proc/self/fd"))
    monkeypatch.setattr(os, refused, raising(OSError(errno.EMFILE, os.strerror(errno.EMFILE))))
    with pytest.raises(ModelError, match="the process that looks at it got no files: Too many open files"):
        ContactModel.load("default", pad)
    assert len(os.listdir("/proc/self/fd")) == before


def raising(error: Exception) -> Callable[[], NoReturn]:
    def function(*_: object) -> NoReturn:
        raise error

    return function


def test_handlers_of_the_daemon_do_not_run_in_the_other_process(
    look: Callable[[Callable[[], object]], None], monkeypatch: pytest.MonkeyPatch, pad: Pad
) -> None:
    def end_both() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        raise ValueError("it goes on")

    handled: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda *_: handled.append(os.write(write, b"!")))
    read, write = os.pipe()
    os.set_blocking(read, False)
    try:
        look(end_both)
        with pytest.raises(ModelError, match="it goes on"):
            ContactModel.load("default", pad)
        with pytest.raises(BlockingIOError):
            os.read(read, 1)
        os.kill(os.getpid(), signal.SIGTERM)  # here they still do
        assert handled == [1]
    finally:
        signal.signal(signal.SIGTERM, before)
        os.close(read)
        os.close(write)


def test_answer_does_not_need_the_exit_code(pad: Pad) -> None:
    """Whoever starts the daemon may have SIGCHLD ignored; nobody keeps exit codes then."""
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        assert ContactModel.load("default", pad).inference.by == "compiled"
        for function in (beside.tried, beside.told):
            with pytest.raises(ValueError, match=r"not an ONNX file|ONNXRuntimeError"):
                function(b"no model at all")
    finally:
        signal.signal(signal.SIGCHLD, before)


def test_model_is_read_once_for_all_pads(look: Callable[[Callable[[], object]], None], pad: Pad) -> None:
    ContactModel.load("default", pad)
    look(lambda: os._exit(1))
    ContactModel.load("default", pad)


# --- its answers ---


def test_network_answers_like_onnxruntime_and_repeats(pad: Pad) -> None:
    from fmfts.contact.session import SessionInference  # the other tests run even without onnxruntime

    model = ContactModel.load("default", pad)
    poses = poses_of(model.facts)
    compiled, session = answers(model.inference, poses), answers(SessionInference(CONTENT), poses)
    largest = np.abs(session).max(axis=0) + np.finfo(np.float32).tiny
    assert (np.abs(compiled - session) <= comparison.ROUNDING * largest).all()
    assert compiled.tobytes() == answers(model.inference, poses).tobytes()


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


def test_missing_number_stays_null(pad: Pad) -> None:
    inference = ContactModel.load("default", pad).inference
    inference.pose[:] = [np.nan, 0.0, 12.0, 0.0, 0.0, 1.0]
    inference.run()
    assert np.isnan(inference.contact).all()


def test_vector_of_another_size_is_refused(pad: Pad) -> None:
    inference = ContactModel.load("default", pad).inference
    assert isinstance(inference, NetworkInference)
    vector = np.frombuffer(inference.network, np.float32)
    room = [np.zeros(count, np.float32).data for count in (6, 3, 18)]
    for wrong in (vector[:-1], np.append(vector, np.float32(0.0)), vector[:2], np.full(9, np.nan, np.float32)):
        with pytest.raises(ValueError, match=r"not that of a network|expected"):
            _contact.infer(wrong.tobytes(), *room)


def test_onnxruntime_model_gives_the_same_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To single precision: it sums in another order."""
    config, frames = config_of(3), frames_of(config_of(3), 8.0)[5 * 220 :]
    baseline = simulated_baseline(config)
    pipeline = pipeline_of(config, baseline)
    ours = [pipeline.process(frame) for frame in frames]
    (tmp_path / "own.onnx").write_bytes(edited(without_weights))
    monkeypatch.setattr("fmfts.contact.model.path_of", lambda _: tmp_path / "own.onnx")
    assert ContactModel.load("default", config.pad()).inference.by == "onnxruntime"
    pipeline = pipeline_of(config, baseline)
    theirs = [pipeline.process(frame) for frame in frames]
    assert any(message.contact for message in ours)
    for one, other in zip(ours, theirs, strict=True):
        assert (one.health, one.contact) == (other.health, other.contact)
        if one.force_n is not None:
            assert other.force_n == pytest.approx(one.force_n, rel=1e-4, abs=1e-6)
            assert other.force_sd_n == pytest.approx(one.force_sd_n, rel=1e-3)
