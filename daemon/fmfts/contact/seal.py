"""The last entries of metadata that `calibrate` appends to a model: its weights, which network.c evaluates, and the
SHA-256 of all before. So any damaged file is refused.

A weight with a wrong bit would be a plausible number, and give plausible forces.
"""

from __future__ import annotations

import hashlib

from fmfts.contact.contract import WEIGHTS_KEY

KEY = "fmfts.sha256"
METADATA = 14  # the field of a ModelProto with entries of metadata: StringStringEntryProto, key 1, value 2
BYTES = 2  # protobuf's wire type of a field with a length


def sealed(model: bytes, weights: str) -> bytes:
    """The model, followed by its weights and the seal. ONNX readers see the same model."""
    return with_seal(model + _entry(WEIGHTS_KEY, weights))


def with_seal(content: bytes) -> bytes:
    return content + _entry(KEY, hashlib.sha256(content).hexdigest())


def unsealed(content: bytes) -> bytes:
    """The model without its seal. A model of another program has none. ValueError if the seal does not fit."""
    model = content[: -len(SEAL)]
    right = with_seal(model)
    if not _is_like(content[len(model) : -len(DIGEST)], SEAL) and not _is_like(
        content[-len(DIGEST) :], right[-len(DIGEST) :]
    ):
        return content
    if right != content:
        raise ValueError("it is damaged, or was edited: it is not the model whose SHA-256 it holds")
    return model


def hash_of(content: bytes, weights: str | None = None) -> str:
    """How messages and recordings name a model: the first twelve hex digits of its SHA-256, without what is behind it.

    content: without its seal. weights: those in its metadata.
    """
    model = content if weights is None else content.removesuffix(_entry(WEIGHTS_KEY, weights))
    return hashlib.sha256(model).hexdigest()[:12]


def _is_like(found: bytes, right: bytes) -> bool:
    """Whether most bytes are those of a seal, which may be damaged itself."""
    return sum(one == other for one, other in zip(found, right, strict=False)) > len(found) // 2


def _entry(key: str, value: str) -> bytes:
    return _field(METADATA, _field(1, key.encode()) + _field(2, value.encode()))


def _field(number: int, content: bytes) -> bytes:
    return bytes([number << 3 | BYTES]) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first; all but the last have the highest bit."""
    return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + _varint(value >> 7)


SEAL = with_seal(b"")
DIGEST = hashlib.sha256(b"").hexdigest().encode()
