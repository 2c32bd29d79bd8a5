"""Encodes messages as msgpack maps, and refuses NaN and infinity, which are never published."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from fmfts.arithmetic._arithmetic import has_finite_numbers
from fmfts.bus.messages import AnyMessage, ContactMessage


class NotFiniteError(ValueError):
    """A message contains NaN or infinity; the text names the field."""


def _plain(value: Any) -> Any:
    """Converts a NumPy scalar to Python's float or int, for msgspec's encoder."""
    if hasattr(value, "item"):
        return value.item()
    raise NotImplementedError(f"a message cannot contain a {type(value).__name__}")


_encoder = msgspec.msgpack.Encoder(enc_hook=_plain)
_contact_decoder = msgspec.msgpack.Decoder(ContactMessage)


def encode(message: AnyMessage) -> bytes:
    """The msgpack map of `message`. Raises NotFiniteError, which names the field, for any NaN or infinity."""
    payload = _encoder.encode(message)
    if not has_finite_numbers(payload) and (field := not_finite_field(message)):
        raise NotFiniteError(f"pad {message.pad!r}: {type(message).__name__}.{field} is not a finite number")
    return payload


def decode_contact(payload: bytes) -> ContactMessage:
    """The ContactMessage of a msgpack map: the inverse of `encode`."""
    return _contact_decoder.decode(payload)


def encode_facts(facts: Any) -> bytes:
    """The msgpack map of free-form facts (an answer of the control socket). Raises NotFiniteError."""
    field = not_finite_field(facts)
    if field:
        raise NotFiniteError(f"{field} is not a finite number")
    return _encoder.encode(facts)


def encoded(facts: Any) -> msgspec.Raw:
    """Facts, or a message, encoded once as a part for later `encode_facts`. Raises NotFiniteError."""
    return msgspec.Raw(encode_facts(facts))


def not_finite_field(value: object, path: str = "") -> str:
    """Path of the first NaN or infinity in a message, map or list; "" where there is none."""
    if isinstance(value, float):
        return "" if math.isfinite(value) else path or "value"
    children: Any = ()
    if isinstance(value, msgspec.Struct):
        children = ((name, getattr(value, name)) for name in value.__struct_fields__)
    elif isinstance(value, dict):
        children = value.items()
    elif isinstance(value, list | tuple):
        children = enumerate(value)
    fields = (not_finite_field(child, f"{path}.{name}" if path else str(name)) for name, child in children)
    return next(filter(None, fields), "")
