"""onnxruntime: evaluates models whose graph our network does not know, and checks our network.

Import it only where it is needed: it takes 30 MB and a tenth of a second.
"""

from __future__ import annotations

import resource
import struct
import sys
import time
from pathlib import Path

import numpy as np
import onnxruntime

from fmfts.contact.contract import OUTPUT_ORDER, SHEAR_OUTPUT_ORDER
from fmfts.contact.graph import INPUT, OUTPUTS
from fmfts.contact.inference import POSE, Inference

# What a model may take: its file has 4 MB at most, and a pad has 4 ms from frame to frame.
MOST_MORE, LONGEST_CPU_S, SLOWEST_S = 1 << 26, 10, 0.02


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
    options.add_session_config_entry("session.load_model_format", "ONNX")  # the format that was looked at
    options.log_severity_level = 4  # errors are raised, and reported in our own words
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no other common base
        raise ValueError(f"onnxruntime does not load it ({(str(error).splitlines() or [''])[0]})") from error


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


def main() -> None:
    """Serve comparison.py: read a model's size, the model and poses from standard input, and write the answers."""
    question = sys.stdin.buffer.read()
    (size,) = struct.unpack_from("<I", question)
    content, poses = question[4 : 4 + size], np.frombuffer(question, "<f4", offset=4 + size).reshape(-1, POSE)
    _limit()
    try:
        session = session_of(content)
        _width_of(session)
        begun_s = time.process_time()
        # One at a time, as in the daemon: what a model takes may depend on how many poses it gets.
        answers = [session.run(list(OUTPUTS), {INPUT: pose[None]}) for pose in poses]
        took_s = (time.process_time() - begun_s) / len(poses)
        if took_s > SLOWEST_S:
            raise ValueError(f"a pose takes {1e3 * took_s:.0f} ms, and may take {1e3 * SLOWEST_S:.0f} ms")
    except ValueError as error:
        raise SystemExit(str(error)) from None
    except Exception as error:  # noqa: BLE001  # of onnxruntime, which says so where memory is short
        raise SystemExit((str(error).splitlines() or [type(error).__name__])[0]) from None
    for contact, jacobian in answers:
        sys.stdout.buffer.write(np.concatenate([contact[:, :, None], jacobian], axis=2).tobytes())


def _limit() -> None:
    """From here on this process may use so much memory more, and so much time: see comparison.py."""
    status = Path("/proc/self/status").read_text()
    (used_kb,) = (int(line.split()[1]) for line in status.splitlines() if line.startswith("VmData:"))
    resource.setrlimit(resource.RLIMIT_DATA, ((used_kb << 10) + MOST_MORE, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_CPU_S, resource.RLIM_INFINITY))


if __name__ == "__main__":
    main()
