"""A model file is read, and has to prove what it is, before anything of it is believed."""

from __future__ import annotations

from pathlib import Path

import onnxruntime

from fmfts.contact.contract import (
    IR_VERSION,
    OPSET,
    OUTPUT_ORDER,
    SHEAR_OUTPUT_ORDER,
    SIZE_LIMIT_BYTES,
    read_versions,
    require_whole,
)
from fmfts.contact.inference import OUTPUTS, last_dimensions


def read(file: Path) -> bytes:
    try:
        with file.open("rb") as stream:
            content = stream.read(SIZE_LIMIT_BYTES + 1)
    except OSError as error:
        raise ValueError(f"it cannot be read ({error.strerror})") from error
    if len(content) > SIZE_LIMIT_BYTES:
        raise ValueError(f"it is larger than {SIZE_LIMIT_BYTES / 1e6:g} MB, no contact model is")
    return content


def check_versions(content: bytes) -> None:
    require_whole(content)
    ir_version, opset = read_versions(content)
    if (ir_version, opset) != (IR_VERSION, OPSET):
        raise ValueError(f"it has IR version {ir_version} and opset {opset}, not {IR_VERSION} and {OPSET}")


def session_of(content: bytes) -> onnxruntime.InferenceSession:
    """One thread that never spins: at onnxruntime's defaults a pad's 220 inferences a second keep a core busy."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.log_severity_level = 4  # what goes wrong is raised, and said in our own words
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no other common base
        raise ValueError(f"onnxruntime does not load it ({str(error).splitlines()[0]})") from error


def check_signature(session: onnxruntime.InferenceSession) -> None:
    inputs, outputs = session.get_inputs(), session.get_outputs()
    names = [tensor.name for tensor in (*inputs, *outputs)]
    if names != ["pose", *OUTPUTS]:
        raise ValueError(f"its tensors are {', '.join(names)}, not pose → contact, jacobian")
    width = outputs[0].shape[-1]
    wanted = last_dimensions(width if width in (len(OUTPUT_ORDER), len(SHEAR_OUTPUT_ORDER)) else len(OUTPUT_ORDER))
    for tensor in (*inputs, *outputs):
        if tensor.type != "tensor(float)":
            raise ValueError(f"{tensor.name} is a {tensor.type}, not a tensor(float)")
        last = wanted[tensor.name]
        if len(tensor.shape) != 1 + len(last) or tensor.shape[1:] != last or isinstance(tensor.shape[0], int):
            raise ValueError(f"{tensor.name} has the shape {tensor.shape}, not {['N', *last]}")
