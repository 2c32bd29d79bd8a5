"""The memory from frame to frame, as msgpack: a dataclass of numbers, flags and arrays."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

Memory = TypeVar("Memory")


def _is_memory(value: object) -> bool:
    """Whether it is a part of its own: a dataclass, or values by name."""
    if isinstance(value, dict):
        return True
    parameters = getattr(value, "__dataclass_params__", None)
    return parameters is not None and not parameters.frozen


def encode(memory: object) -> bytes:
    return msgspec.msgpack.encode(memory, enc_hook=_encoded)


def decode(content: bytes, kind: type[Memory]) -> Memory:
    """ValueError if it is no memory of that kind."""
    return msgspec.msgpack.decode(content, type=kind, dec_hook=_decoded)


def require_alike(memory: Any, other: Any, where: str = "") -> None:
    """ValueError where arrays have other shapes, or one of them lacks a part that the other has."""
    if type(memory) is not type(other) and (_is_memory(memory) or _is_memory(other)):
        if _is_memory(memory) and _is_memory(other):
            raise ValueError(f"{where} is of another kind of pad")
        has, lacks = ("the state", "this pad") if _is_memory(memory) else ("this pad", "the state")
        raise ValueError(f"{has} remembers {where}, and {lacks} does not")
    if isinstance(memory, np.ndarray) and isinstance(other, np.ndarray) and _form(memory) != _form(other):
        raise ValueError(f"{where} has the shape {_form(memory)}, not {_form(other)}")
    if _is_memory(memory):
        one, another = (_parts(each) for each in (memory, other))
        if set(one) != set(another):
            unknown = ", ".join(sorted(set(one) ^ set(another))[:3])
            raise ValueError(f"{where} has other fields than this version has ({unknown} …)")
        for name in one:
            require_alike(one[name], another[name], f"{where}.{name}".lstrip("."))


def _form(array: NDArray[Any]) -> tuple[tuple[int, ...], str]:
    return array.shape, array.dtype.str


def _parts(memory: Any) -> dict[str, Any]:
    return memory if isinstance(memory, dict) else {each.name: getattr(memory, each.name) for each in fields(memory)}


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"array": value.tobytes(), "type": value.dtype.str, "shape": value.shape}
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} is no part of a memory")


def _decoded(kind: Any, value: Any) -> Any:
    if not isinstance(value, dict) or getattr(kind, "__origin__", kind) is not np.ndarray:
        raise ValueError(f"there is no {kind} in a memory")
    return np.frombuffer(value["array"], np.dtype(value["type"])).reshape(value["shape"]).copy()
