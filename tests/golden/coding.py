"""Whole numbers in few bytes: small changes from row to row cost little."""

from __future__ import annotations

import lzma
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

Whole = NDArray[np.int64]
PRESET = 9 | lzma.PRESET_EXTREME


def packed(values: Whole, differences: int) -> dict[str, Any]:
    """The `differences`-th differences of the rows (K, …), column after column, one plane for each byte of a number."""
    table = values.reshape(len(values), -1).astype(np.int64)
    for _ in range(differences):
        table = np.diff(table, axis=0, prepend=np.zeros((1, table.shape[1]), np.int64))
    folded = ((table << 1) ^ (table >> 63)).T.astype("<u8")
    planes = np.ascontiguousarray(folded).view(np.uint8).reshape(-1, 8).T
    used = max(int(np.flatnonzero(planes.any(axis=1)).max(initial=0)) + 1, 1)
    return {"shape": list(values.shape), "differences": differences, "planes": [one.tobytes() for one in planes[:used]]}


def unpacked(content: dict[str, Any]) -> Whole:
    shape = tuple(content["shape"])
    columns = int(np.prod(shape[1:], dtype=int))
    folded = np.zeros(shape[0] * columns, np.uint64)
    for place, plane in enumerate(content["planes"]):
        folded |= np.frombuffer(plane, np.uint8).astype(np.uint64) << np.uint64(8 * place)
    table = (folded >> np.uint64(1)).astype(np.int64) ^ -(folded & np.uint64(1)).astype(np.int64)
    table = table.reshape(columns, shape[0]).T
    for _ in range(content["differences"]):
        table = np.cumsum(table, axis=0)
    return table.reshape(shape)


def compressed(content: Any) -> bytes:
    return lzma.compress(msgspec.msgpack.encode(content), preset=PRESET)


def expanded(content: bytes) -> Any:
    return msgspec.msgpack.decode(lzma.decompress(content))
