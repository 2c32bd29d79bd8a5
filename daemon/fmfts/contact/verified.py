"""Reads a model file, and verifies it before it is used."""

from __future__ import annotations

import logging
from pathlib import Path

from fmfts.common.reading import read_regular
from fmfts.contact.beside import Told, tried
from fmfts.contact.comparison import difference
from fmfts.contact.contract import SIZE_LIMIT_BYTES, Facts, parse_weights
from fmfts.contact.inference import CompiledInference, Inference

log = logging.getLogger(__name__)

_differences: dict[bytes, str | None] = {}  # results by model: each model is compared only once


def read(file: Path) -> bytes:
    try:
        content = read_regular(file, SIZE_LIMIT_BYTES + 1)
    except OSError as error:
        raise ValueError(f"it cannot be read ({error.strerror})") from error
    if len(content) > SIZE_LIMIT_BYTES:
        raise ValueError(f"it is larger than {SIZE_LIMIT_BYTES / 1e6:g} MB: no contact model is")
    return content


def inference_of(content: bytes, model: Told, facts: Facts) -> Inference:
    """Our own network with the model's weights; onnxruntime if there are none, or if their answers differ.

    ValueError if onnxruntime cannot evaluate it.
    """
    weights = parse_weights(model.metadata)
    if weights is None:
        return _by_onnxruntime(content)
    inference = CompiledInference(weights)
    if content not in _differences:
        _differences[content] = difference(inference, model.answers_of(len(inference.contact)), facts)
    different = _differences[content]
    if different is None:
        return inference
    log.error("the compiled contact model is not used: %s; worth reporting", different)
    return _by_onnxruntime(content)


def _by_onnxruntime(content: bytes) -> Inference:
    model = tried(content)
    from fmfts.contact.session import SessionInference  # imported here: 30 MB that most daemons do not need

    return SessionInference(model)
