"""A contact model's own hash, as its last entry of metadata: a damaged file is refused, whatever the damage.

A weight with another bit is a number like any other, and the model with it answers forces like any other.
"""

from __future__ import annotations

import hashlib

KEY = b"fmfts.sha256"
METADATA = 14  # the field of a ModelProto with entries of metadata: StringStringEntryProto, key 1, value 2
BYTES = 2  # protobuf's wire type of a field that tells its length


def sealed(model: bytes) -> bytes:
    """The model, and its SHA-256 behind it. It is the same model to every reader of ONNX."""
    entry = _field(1, KEY) + _field(2, hashlib.sha256(model).hexdigest().encode())
    return model + _field(METADATA, entry)


def unsealed(content: bytes) -> bytes:
    """The model without its seal. A model without one is of an older version. ValueError if the seal does not fit."""
    model = content[: -len(SEAL)]
    right = sealed(model)
    if not _is_like(content[len(model) : -len(DIGEST)], SEAL) and not _is_like(
        content[-len(DIGEST) :], right[-len(DIGEST) :]
    ):
        return content
    if right != content:
        raise ValueError("it is damaged, or was edited: it is not the model whose SHA-256 it holds")
    return model


def hash_of(model: bytes) -> str:
    """How messages and recordings name a model: the first twelve hex digits of its SHA-256, without the seal."""
    return hashlib.sha256(model).hexdigest()[:12]


def _is_like(found: bytes, right: bytes) -> bool:
    """Whether most of the bytes are those of a seal: it may be damaged itself."""
    return sum(one == other for one, other in zip(found, right, strict=False)) > len(found) // 2


def _field(number: int, content: bytes) -> bytes:
    assert len(content) < 128  # so that the length is one byte
    return bytes([number << 3 | BYTES, len(content)]) + content


SEAL = sealed(b"")
DIGEST = hashlib.sha256(b"").hexdigest().encode()
