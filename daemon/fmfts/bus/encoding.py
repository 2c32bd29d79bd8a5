"""Encodes messages as msgpack maps, and refuses NaN and infinity, which are never published."""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import attrgetter
from typing import Any

import msgspec

from fmfts.bus.messages import AnyMessage, ContactMessage, FingerMessage, NowMessage, PoseMessage


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
    if not _numbers_are_finite(message):
        field = not_finite_field(message)
        raise NotFiniteError(f"pad {message.pad!r}: {type(message).__name__}.{field} is not a finite number")
    return _encoder.encode(message)


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


def _getter(kind: type[msgspec.Struct], item: str) -> Callable[[Any], tuple[Any, ...]]:
    """A function that gets, in one call, all fields of `kind` annotated as `item` or `item | None`."""
    names = [name for name, hint in kind.__annotations__.items() if hint in (item, f"{item} | None")]
    getter: Callable[[Any], tuple[Any, ...]] = attrgetter(*names)
    return getter


_contact_numbers = _getter(ContactMessage, "float")
_pose_numbers = _getter(PoseMessage, "float")
_pose_vectors = _getter(PoseMessage, "Vector")
_now_numbers = _getter(NowMessage, "float")
_finger_numbers = _getter(FingerMessage, "float")


def _numbers_are_finite(message: AnyMessage) -> bool:
    """Fast for contacts, which are frequent: one sum of all numbers, which is finite only if all its terms are."""
    if not isinstance(message, ContactMessage):
        return not not_finite_field(message)
    total = sum(filter(None, _contact_numbers(message)))
    if (now := message.now) is not None:
        total += sum(filter(None, _now_numbers(now)))
    if (pose := message.pose) is not None:
        total += _sum_of_pose(pose)
    if message.contacts:  # neither unset nor null nor empty
        total += sum(sum(filter(None, _finger_numbers(finger))) for finger in message.contacts)
    if message.poses:
        total += sum(map(_sum_of_pose, message.poses))
    return math.isfinite(total)


def _sum_of_pose(pose: PoseMessage) -> float:
    total: float = sum(_pose_numbers(pose)) + sum(map(sum, filter(None, _pose_vectors(pose))))
    return total
