"""Reads a model file, and verifies it before it is used."""

from __future__ import annotations

import logging
from pathlib import Path

from fmfts.common.reading import read_regular
from fmfts.contact.comparison import NotComparedError, difference, require_modest
from fmfts.contact.contract import IR_VERSION, OPSET, SIZE_LIMIT_BYTES, Facts
from fmfts.contact.inference import CompiledInference, Inference, NetworkInference
from fmfts.contact.onnx_file import Graph, OnnxFile
from fmfts.contact.recognition import network_of

log = logging.getLogger(__name__)

_differences: dict[bytes, str | None] = {}  # by network: each network is compared only once


def read(file: Path) -> bytes:
    try:
        content = read_regular(file, SIZE_LIMIT_BYTES + 1)
    except OSError as error:
        raise ValueError(f"it cannot be read ({error.strerror})") from error
    if len(content) > SIZE_LIMIT_BYTES:
        raise ValueError(f"it is larger than {SIZE_LIMIT_BYTES / 1e6:g} MB: no contact model is")
    return content


def check_versions(model: OnnxFile) -> None:
    if (model.ir_version, model.opset) != (IR_VERSION, OPSET):
        raise ValueError(f"it has IR version {model.ir_version} and opset {model.opset}, not {IR_VERSION} and {OPSET}")


def inference_of(content: bytes, graph: Graph, facts: Facts) -> Inference:
    """Our own network if it knows the graph; else onnxruntime. ValueError if that fails."""
    network = network_of(graph)
    if network is not None:
        return CompiledInference(network)
    return _by_onnxruntime(content, facts)


def compared(inference: Inference, content: bytes, facts: Facts) -> Inference:
    """`inference`, or that of onnxruntime if our network gives different answers."""
    if not isinstance(inference, NetworkInference):
        return inference
    if inference.network not in _differences:
        _differences[inference.network] = _difference(inference, content, facts)
    different = _differences[inference.network]
    if different is None:
        return inference
    log.error("the compiled contact model is not used: %s; worth reporting", different)
    return _by_onnxruntime(content, facts)


def _difference(inference: NetworkInference, content: bytes, facts: Facts) -> str | None:
    try:
        return difference(inference, content, facts)
    except NotComparedError as error:
        log.warning("the compiled contact model could not be compared with onnxruntime: %s", error)
        return None


def _by_onnxruntime(content: bytes, facts: Facts) -> Inference:
    try:
        require_modest(content, facts)
    except NotComparedError as error:
        raise ValueError(f"onnxruntime cannot evaluate it within a pad's means: {error}") from error
    from fmfts.contact.session import SessionInference  # 30 MB that most daemons do not need

    return SessionInference(content)
