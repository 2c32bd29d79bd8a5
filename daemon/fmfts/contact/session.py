"""Evaluates a model with onnxruntime, and checks one in a process of its own (beside.py).

Import it only if needed: it takes 30 MB and a tenth of a second.
"""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import numpy as np
import onnxruntime

from fmfts.contact.beside import FORKS, Told
from fmfts.contact.comparison import Poses, poses_of
from fmfts.contact.contract import (
    EXTERNAL,
    INPUT,
    OUTPUT_ORDER,
    OUTPUTS,
    SHEAR_OUTPUT_ORDER,
    WEIGHTS_KEY,
    parse_facts,
)
from fmfts.contact.inference import POSE, Inference

# Limits of memory and time: a model's file has 4 MB at most, and a pad 4 ms a frame.
MOST_MORE, LONGEST_CPU_S, SLOWEST_S = 1 << 26, 10, 0.02
PROBED_EVERY = 29  # one in so many poses of the comparison: of each share, corners and others


class SessionInference(Inference):
    """Evaluates a model with onnxruntime. Buffers are bound only once, which saves the overhead of `session.run`.

    ValueError if the model does not load, or its inputs and outputs are not those of the contract.
    """

    by = "onnxruntime"

    def __init__(self, content: bytes) -> None:
        self.session = session_of(content)
        super().__init__(outputs=_width_of(self.session))
        self._binding = self.session.io_binding()
        for name, array in zip((INPUT, *OUTPUTS), (self.pose, self.contact, self.jacobian), strict=True):
            bind = self._binding.bind_output if name in OUTPUTS else self._binding.bind_input
            bind(name, "cpu", 0, np.float32, [1, *array.shape], array.ctypes.data)

    def run(self) -> None:
        self.session.run_with_iobinding(self._binding)


def session_of(content: bytes) -> onnxruntime.InferenceSession:
    """A session with one thread that never spins: with default options, 220 inferences a second keep a core busy."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.add_session_config_entry("session.load_model_format", "ONNX")  # the format to check
    options.log_severity_level = 4  # errors are raised, and reported in our own words
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no other common base
        said = (str(error).splitlines() or [""])[0]
        if "external" in said.lower():
            raise ValueError(EXTERNAL) from error
        if "protobuf" in said.lower():
            raise ValueError(f"it is not an ONNX file, or a truncated one ({said})") from error
        raise ValueError(f"onnxruntime does not load it ({said})") from error


def _width_of(session: onnxruntime.InferenceSession) -> int:
    """The number of outputs of the contact. ValueError if the tensors are not those of the contract."""
    tensors = (*session.get_inputs(), *session.get_outputs())
    names = [tensor.name for tensor in tensors]
    if names != [INPUT, *OUTPUTS]:
        raise ValueError(f"its tensors are {', '.join(names)}, not pose → contact, jacobian")
    width = tensors[1].shape[-1]
    width = width if width in (len(OUTPUT_ORDER), len(SHEAR_OUTPUT_ORDER)) else len(OUTPUT_ORDER)
    for tensor, last in zip(tensors, ([POSE], [width], [width, POSE]), strict=True):
        if tensor.type != "tensor(float)":
            raise ValueError(f"{tensor.name} is a {tensor.type}, not a tensor(float)")
        if len(tensor.shape) != 1 + len(last) or tensor.shape[1:] != last or isinstance(tensor.shape[0], int):
            raise ValueError(f"{tensor.name} has the shape {tensor.shape}, not {['N', *last]}")
    return int(width)


def tell(content: bytes) -> bytes:
    """A `Told` of this model."""
    _limit()
    session = session_of(content)
    _width_of(session)
    metadata, answers = dict(session.get_modelmeta().custom_metadata_map), b""
    if WEIGHTS_KEY in metadata:
        answers = _answers(session, poses_of(parse_facts(metadata)))
    return msgspec.msgpack.encode(Told(metadata, answers))


def try_out(content: bytes) -> bytes:
    """The model, after a look at its operators and a few poses: a few bytes of ONNX may need any time and memory."""
    from fmfts.contact.operators import require_even

    content = require_even(content)
    try:
        _limit()
        session = session_of(content)
        _width_of(session)
        facts = parse_facts(session.get_modelmeta().custom_metadata_map)
        poses = np.concatenate([np.zeros((1, POSE), np.float32), poses_of(facts)[::PROBED_EVERY]])
        begun_s = time.process_time()
        _answers(session, poses)
        took_s = (time.process_time() - begun_s) / len(poses)
        if took_s > SLOWEST_S:
            raise ValueError(f"a pose takes {1e3 * took_s:.0f} ms, and may take {1e3 * SLOWEST_S:.0f} ms")
    except Exception as error:  # of onnxruntime, which says so where memory is short
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(f"onnxruntime cannot evaluate it within a pad's means: {said}") from error
    return content


def _answers(session: onnxruntime.InferenceSession, poses: Poses) -> bytes:
    """One at a time, as in the daemon: a model's cost may depend on the number of poses."""
    answers = [session.run(list(OUTPUTS), {INPUT: pose[None]}) for pose in poses]
    return b"".join(np.concatenate([contact[:, :, None], slope], axis=2).tobytes() for contact, slope in answers)


def _limit() -> None:
    """Limit the memory and time that this process may use from here on, if it looks at a model and ends."""
    if not FORKS:
        return
    import resource

    status = Path("/proc/self/status").read_text()
    (used_kb,) = (int(line.split()[1]) for line in status.splitlines() if line.startswith("VmData:"))
    resource.setrlimit(resource.RLIMIT_DATA, ((used_kb << 10) + MOST_MORE, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_CPU_S, resource.RLIM_INFINITY))
