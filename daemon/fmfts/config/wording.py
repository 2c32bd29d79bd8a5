"""Describes the place of an error in the file, the value there, and the allowed values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence
from typing import Any

from msgspec import inspect

from fmfts.config import Config, PadName
from fmfts.config.section import Key
from fmfts.config.sources import BoardUid, lacking_source

# What the items of a list are called; people count them from 1.
ITEMS = {
    "sensors_mm": "sensor",
    "sensor_rotations_deg": "sensor",
    "channels": "sensor",
    "mux_addresses": "sensor",
    "addresses": "sensor",
    "neighbours": "name",
    "pad": "pad",
}
IN_METRES = ": is it in metres?"
MOST_SHOWN = 80  # characters of a value
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
UNITS = {
    "mm": "millimetres",
    "deg": "degrees",
    "t": "tesla",
    "hz": "hertz",
    "gauss": "gauss",
    "k": "kelvin",
    "minute": "minutes",
}
# How alike a wrong key and a right one must be: in its own table, which is preferred by OWN, and in another one.
LEAST_ALIKE, MUCH_ALIKE, OWN, ALMOST = 0.5, 0.75, 0.1, 0.95

PATTERNS = {
    inspect.type_info(PadName).pattern: "1 to 32 letters without accents, digits, - or _, and no spaces",  # type: ignore[attr-defined]
    inspect.type_info(BoardUid).pattern: "24 hexadecimal digits",  # type: ignore[attr-defined]
}


def keys_in(error: str) -> list[Key]:
    """The path in msgspec's "what - at `$.pad[0].source.rate_hz`"."""
    path = error.partition(" - at ")[2]
    return [int(index) if index else name for name, index in re.findall(r"\.(\w[\w-]*)|\[(\d+)\]", path)]


def explain(data: dict[str, Any], error: str, mended: dict[str, Any], whole: type[Config]) -> str:
    """Rewrites msgspec's text of an error for a person who edits the file.

    mended: `data` with a known type in each table, which gives the allowed keys. whole: of the file.
    """
    what, keys = error.partition(" - at ")[0], keys_in(error)
    if missing := re.search(r"missing required field `(.*)`", what):
        kind = _field_type(type_at(mended, keys, whole), missing[1])
        name = ".".join(key for key in (*keys, missing[1]) if isinstance(key, str))
        shown = f"[[{name}]]" if isinstance(kind, inspect.VarTupleType) else f"[{name}]"
        given = f"the table {shown}" if any(_tables(kind, name)) else _allowed(kind)
        return f"{place(data, [*keys, missing[1]])} is missing: give {given}"
    if unknown := re.search(r"unknown field `(.*)`", what):
        nearest = _nearest(type_at(mended, keys, whole), unknown[1], whole)
        return f"{place(data, [*keys, unknown[1]])}: there is no such key{nearest}"
    if keys[-1:] == ["type"] and (how := lacking_source(value_at(data, keys))) is not None:
        return f"{place(data, keys)}{value_shown(data, keys)}: {how}"
    kind, value = type_at(mended, keys, whole), value_at(data, keys)
    is_text = isinstance(kind, inspect.StrType) and isinstance(value, str)  # in quotes already
    allowed = _allowed(kind).removeprefix("text in quotes: ") if is_text else _allowed(kind)
    return f"{place(data, keys)}{value_shown(data, keys)}: must be {allowed}{_meant(kind, keys, value)}"


def _meant(kind: inspect.Type, keys: Sequence[Key], value: Any) -> str:
    """The probably intended word of a list, the number in a text, or the unit."""
    if isinstance(kind, inspect.IntType | inspect.FloatType) and isinstance(value, str):
        return ", without quotes"
    if isinstance(kind, inspect.FloatType) and str(keys[-1]).endswith("_mm") and isinstance(value, float):
        return IN_METRES if kind.ge is not None and 0.0 < value < kind.ge <= value * 1e3 else ""
    if not isinstance(kind, inspect.LiteralType) or not isinstance(value, str):
        return ""
    near = difflib.get_close_matches(value.lower(), [str(word) for word in kind.values], n=1)
    return f'; did you mean "{near[0]}"?' if near else ""


def _nearest(table: inspect.Type, unknown: str, whole: type[Config]) -> str:
    """The key that was probably meant: of this table, or of another one, with the table's name."""
    known = [field.name for field in _fields(table)]
    found = [(_alike(unknown, name) + OWN, -len(name), name, name) for name in known]
    found = [each for each in found if each[0] >= LEAST_ALIKE + OWN]
    for path, other in _tables(inspect.type_info(whole)):
        for name, kind in () if other is table else _keys(other):
            if (alike := _alike(unknown, name)) >= MUCH_ALIKE:
                of_type = f' of type "{other.tag}"' if other.tag and getattr(table, "tag", None) else ""
                found.append((alike, -len(name), name, _within(path, name, kind) + of_type))
    if not found:
        return f" (there are {', '.join(known)})"
    *_, name, words = max(found, key=lambda each: each[:2])  # the first of the likeliest
    unit = UNITS.get(name.rpartition("_")[2])
    return f"; did you mean {words}{f', in {unit}' if unit else ''}?"


def _within(path: str, name: str, kind: inspect.Type) -> str:
    """A key as the file has it, with the table at `path`."""
    if any(_tables(kind, path)):
        return f"[{path}.{name}]"
    return f"[[{path}]] {name}" if path == "pad" else f"[{path}] {name}"


def _alike(unknown: str, name: str) -> float:
    """1 if they are the same, or the same but for words at the end: units are forgotten most often."""
    if f"{name}_".startswith(f"{unknown}_"):
        return 1.0 if name == unknown else ALMOST
    return difflib.SequenceMatcher(None, unknown, name).ratio() * ALMOST


def _tables(kind: inspect.Type, path: str = "") -> Iterator[tuple[str, inspect.StructType]]:
    """Every table within the others, and its dotted name."""
    kinds = kind.types if isinstance(kind, inspect.UnionType) else (getattr(kind, "item_type", kind),)
    for table in kinds:
        if isinstance(table, inspect.StructType):
            if path:
                yield path, table
            for field in table.fields:
                yield from _tables(field.type, f"{path}.{field.name}".lstrip("."))


def _keys(table: inspect.StructType) -> Iterator[tuple[str, inspect.Type]]:
    yield from ((field.name, field.type) for field in table.fields)
    yield from [("type", inspect.StrType())] if table.tag else []


def place(data: dict[str, Any], keys: Sequence[Key]) -> str:
    """The path of a key in words, like `pad 'left' (second [[pad]]): geometry.sensors_mm[1]`."""
    if len(keys) >= 2 and keys[0] == "pad" and isinstance(keys[1], int):
        number = keys[1]
        name = value_at(data, ["pad", number, "name"])
        ordinal = ORDINALS[number] if number < len(ORDINALS) else f"{number + 1}th"
        who = f"pad {name!r} ({ordinal} [[pad]])" if isinstance(name, str) else f"{ordinal} [[pad]]"
        return f"{who}: {_dotted(keys[2:])}" if len(keys) > 2 else who
    return _dotted(keys) or "the file"


def _dotted(keys: Sequence[Key]) -> str:
    words, what = "", "value"
    for key in keys:
        words += f", {what} {key + 1}" if isinstance(key, int) else f".{key}"
        what = ITEMS.get(key, "value") if isinstance(key, str) else "value"
    return words.removeprefix(".")


def value_at(data: Any, keys: Sequence[Key]) -> Any:
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def value_shown(data: dict[str, Any], keys: Sequence[Key]) -> str:
    value = value_at(data, keys)
    if value is None or isinstance(value, dict):
        return ""
    shown = str(value).lower() if isinstance(value, bool) else repr(value) if isinstance(value, str) else str(value)
    text = f" = {shown}"
    return text if len(text) <= MOST_SHOWN else f"{text[: MOST_SHOWN - 1]}…"


def numbers(value: Any, keys: tuple[Key, ...] = ()) -> Iterator[tuple[tuple[Key, ...], float]]:
    if isinstance(value, float):
        yield keys, value
    children: Any = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from numbers(child, (*keys, key))


def type_at(data: Any, keys: Sequence[Key], whole: type[Config]) -> inspect.Type:
    kind: inspect.Type = inspect.type_info(whole)
    for key in keys:
        if isinstance(kind, inspect.UnionType):
            kind = _chosen(kind, data)
        data = value_at(data, [key])
        if isinstance(kind, inspect.VarTupleType):
            kind = kind.item_type
        elif isinstance(kind, inspect.TupleType) and isinstance(key, int):
            kind = kind.item_types[key]
        else:
            kind = _field_type(kind, str(key))
    return _chosen(kind, data) if isinstance(kind, inspect.UnionType) else kind


def _chosen(union: inspect.UnionType, data: Any) -> inspect.Type:
    """The table type that `type = …` in `data` names, or the type beside None; `union` where `type` names none."""
    tables = [each for each in union.types if isinstance(each, inspect.StructType)]
    if not tables:
        return next(each for each in union.types if not isinstance(each, inspect.NoneType))
    tag = data.get("type") if isinstance(data, dict) else None
    return next((table for table in tables if table.tag == tag), union)


def _fields(table: inspect.Type) -> tuple[inspect.Field, ...]:
    return table.fields if isinstance(table, inspect.StructType) else ()


def _field_type(table: inspect.Type, name: str) -> inspect.Type:
    if name == "type":
        tables = table.types if isinstance(table, inspect.UnionType) else (table,)
        return inspect.LiteralType(tuple(each.tag for each in tables if isinstance(each, inspect.StructType)))
    return next((field.type for field in _fields(table) if field.name == name), inspect.AnyType())


def _allowed(kind: inspect.Type) -> str:
    if isinstance(kind, inspect.LiteralType):
        return "one of " + ", ".join(f'"{value}"' for value in sorted(map(str, kind.values)))
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        return ("a whole number" if isinstance(kind, inspect.IntType) else "a number") + _bounds(kind)
    if isinstance(kind, inspect.StrType):
        return "text in quotes" + (f": {PATTERNS[kind.pattern]}" if kind.pattern else "")
    if isinstance(kind, inspect.BoolType):
        return "true or false"
    if isinstance(kind, inspect.TupleType):
        return f"a list of {len(kind.item_types)}, each {_allowed(kind.item_types[0])}"
    if isinstance(kind, inspect.VarTupleType):
        is_table = isinstance(kind.item_type, inspect.StructType)
        return "a list of tables ([[double brackets]])" if is_table else f"a list, each {_allowed(kind.item_type)}"
    return "a table"


def _bounds(kind: inspect.IntType | inspect.FloatType) -> str:
    if kind.ge is not None and kind.le is not None:
        return f" from {kind.ge} to {kind.le}"
    words = {"greater than": kind.gt, "at least": kind.ge, "at most": kind.le, "less than": kind.lt}
    limits = [f"{word} {bound}" for word, bound in words.items() if bound is not None]
    return " " + " and ".join(limits) if limits else ""
