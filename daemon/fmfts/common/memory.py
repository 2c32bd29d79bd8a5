"""What one frame leaves to the next: a filter's memory, declared once as a dataclass of numbers, flags and arrays.

The same declaration serves the hand-over to C, by the names of its fields, and recordings, as msgpack.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.common.double_table import DoubleTable

Memory = TypeVar("Memory")
_known: dict[tuple[type[Any], frozenset[str]], tuple[list[str], list[str]]] = {}  # what _fields_of found


def hand_over(memory: Any, table: DoubleTable) -> None:
    """Write every field that the table has, and those of the memories within."""
    shared, others = _fields_of(type(memory), table.names)
    for name in shared:
        value = getattr(memory, name)
        if value is None:
            continue  # there is nothing to go on from, and C makes nothing of it
        table.put(name, value.vector() if hasattr(value, "vector") else value)
    for name in others:
        value = getattr(memory, name)
        if _is_memory(value):
            hand_over(value, table)


def resume(memory: Any, table: DoubleTable) -> None:
    """Take back what `hand_over` wrote and C went on with, each field in the type that it had."""
    shared, others = _fields_of(type(memory), table.names)
    for name in shared:
        if getattr(memory, name) is None:
            continue
        setattr(memory, name, _like(getattr(memory, name), table[name]))
    for name in others:
        value = getattr(memory, name)
        if _is_memory(value):
            resume(value, table)


def _fields_of(kind: type[Any], names: frozenset[str]) -> tuple[list[str], list[str]]:
    """Of a memory: those that a table of these names has, and the others."""
    if (kind, names) not in _known:
        own = [each.name for each in fields(kind)]
        _known[kind, names] = [name for name in own if name in names], [name for name in own if name not in names]
    return _known[kind, names]


def _is_memory(value: object) -> bool:
    """A frozen dataclass is a value, which may be there or not."""
    parameters = getattr(value, "__dataclass_params__", None)
    return parameters is not None and not parameters.frozen


def _like(value: Any, numbers: NDArray[np.float64]) -> Any:
    if isinstance(value, np.ndarray):
        return numbers[: value.size].reshape(value.shape).astype(value.dtype)
    if hasattr(value, "vector"):  # as State has
        return type(value).from_vector(numbers.copy())
    return type(value)(numbers[0])


def encode(memory: object) -> bytes:
    return msgspec.msgpack.encode(memory, enc_hook=_encoded)


def decode(content: bytes, kind: type[Memory]) -> Memory:
    """ValueError where it is no memory of that kind."""
    return msgspec.msgpack.decode(content, type=kind, dec_hook=_decoded)


def convert(values: object, kind: type[Memory]) -> Memory:
    """From the maps and lists of a memory. ValueError where they are none of that kind."""
    return msgspec.convert(values, kind, dec_hook=_decoded)


def require_alike(memory: Any, other: Any, where: str = "") -> None:
    """ValueError where arrays have other shapes, or one of them lacks a part that the other has."""
    if type(memory) is not type(other) and (_is_memory(memory) or _is_memory(other)):
        raise ValueError(f"{where} is {type(memory).__name__}, not {type(other).__name__}")
    if isinstance(memory, np.ndarray) and isinstance(other, np.ndarray) and memory.shape != other.shape:
        raise ValueError(f"{where} has the shape {memory.shape}, not {other.shape}")
    if _is_memory(memory):
        for each in fields(memory):
            name = f"{where}.{each.name}".lstrip(".")
            require_alike(getattr(memory, each.name), getattr(other, each.name), name)


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
