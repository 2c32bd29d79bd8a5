"""From the file's tables to a configuration, with all their errors at once. msgspec stops at the first error.

Here each wrong key is reported, mended in a copy, and the copy is read again.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import msgspec
from msgspec import inspect

from fmfts.config import Config
from fmfts.config.section import Key
from fmfts.config.wording import explain, keys_in, numbers, place, type_at, value_at

MOST = 50  # most errors that are reported
Kind = TypeVar("Kind", bound=Config)


@dataclass(frozen=True, slots=True)
class Converted(Generic[Kind]):
    """config: None if the file is unusable. wrong: sentences. mended: paths to replaced values."""

    config: Kind | None
    wrong: tuple[str, ...]
    mended: tuple[tuple[Key, ...], ...]

    def is_mended(self, keys: Sequence[Key]) -> bool:
        """Is this a path to a replaced value, or within or around one?"""
        return any(tuple(keys[: len(path)]) == path or path[: len(keys)] == tuple(keys) for path in self.mended)


def convert(data: dict[str, Any], kind: type[Kind]) -> Converted[Kind]:
    """Read the tables of a file. If `wrong` is not empty, `config` is only good for looking for more errors."""
    left = copy.deepcopy(data)
    wrong: list[str] = []
    mended: list[tuple[Key, ...]] = []
    for keys, number in numbers(data):
        if not math.isfinite(number):
            wrong.append(f"{place(data, keys)} = {number}: must be a finite number")
            mended.append(_mend(left, keys))
    while len(wrong) < MOST:
        try:
            return Converted(msgspec.convert(left, kind), tuple(wrong), tuple(mended))
        except msgspec.ValidationError as error:
            text = str(error)
            keys = tuple(keys_in(text))
            missing = re.search(r"missing required field `([^`]*)`", text)
            named = missing or re.search(r"unknown field `([^`]*)`", text)
            path = (*keys, named[1]) if named else keys
            # A table's keys depend on its type: those of a replaced type were not in the file.
            if not (missing and path in mended) and not (named and (*keys, "type") in mended):
                wrong.append(explain(data, text, left, kind))
            if not (_fill(left, path, kind) if missing else path):
                break
            mended.append(path if missing else _mend(left, path))
    return Converted(None, tuple(wrong), tuple(mended))


def _mend(data: dict[str, Any], keys: Sequence[Key]) -> tuple[Key, ...]:
    """Remove the value, or the whole list around it: a list of another length would also be wrong."""
    path = list(keys)
    while path and not (isinstance(path[-1], str) and isinstance(value_at(data, path[:-1]), dict)):
        path.pop()
    if path:
        value_at(data, path[:-1]).pop(path[-1], None)
    return tuple(path)


def _fill(data: dict[str, Any], keys: Sequence[Key], whole: type[Config]) -> bool:
    """Insert an allowed value for a missing required key. False if none is known."""
    table, name = value_at(data, keys[:-1]), str(keys[-1])
    if not isinstance(table, dict) or name in table:
        return False
    kind = type_at(data, keys, whole)
    if name == "source":
        table[name] = {"type": "simulated"}
    elif name == "type":
        table[name] = _likely_type(type_at(data, keys[:-1], whole), table)
    elif name == "name":
        table[name] = f"unnamed{keys[1]}"
    elif isinstance(kind, inspect.StrType):
        table[name] = "/dev/null"
    elif isinstance(kind, inspect.IntType | inspect.FloatType):
        table[name] = kind.ge if kind.ge is not None else 1
    else:
        return False
    return True


def _likely_type(union: inspect.Type, table: dict[str, Any]) -> str:
    """Among the table's possible types, the one with most of its keys, then with the fewest required keys."""
    assert isinstance(union, inspect.UnionType)

    def likelihood(kind: inspect.StructType) -> tuple[int, int]:
        return sum(field.name in table for field in kind.fields), -sum(field.required for field in kind.fields)

    return str(max((kind for kind in union.types if isinstance(kind, inspect.StructType)), key=likelihood).tag)
