"""Finds and reads the configuration file. Every error names the file, table, key and value, and what is allowed."""

from __future__ import annotations

import difflib
import math
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

from fmfts.config import BoardUid, Config, PadName, ReplaySource, SimulatedSource
from fmfts.config.checks import problem_in
from fmfts.contact.no_model import NO_MODEL
from fmfts.contact.shipped import SHIPPED_PATHS

ENVIRONMENT = "FMFTS_CONFIG"
DEFAULT_PATHS = (Path("/etc/fmfts/config.toml"), Path("config.toml"))
Key = str | int
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

PATTERNS = {
    inspect.type_info(PadName).pattern: "1 to 32 letters, digits, - or _",  # type: ignore[attr-defined]
    inspect.type_info(BoardUid).pattern: "24 hexadecimal digits",  # type: ignore[attr-defined]
}


class ConfigError(Exception):
    """The configuration cannot be used (exit code 78)."""


def load(path: Path | None = None, environ: Mapping[str, str] = os.environ) -> tuple[Config, Path]:
    """The configuration, and the file that it was read from: `path`, else $FMFTS_CONFIG, else DEFAULT_PATHS in order.

    Relative paths in the file are relative to its folder, and are absolute in the result. Raises ConfigError.
    """
    file = _find(path, environ)
    data = _read(file)
    for keys, number in _numbers(data):
        if not math.isfinite(number):
            raise ConfigError(f"{file}: {_place(data, keys)} = {number}: must be a finite number")
    try:
        config = msgspec.convert(data, Config)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{file}: {_explain(data, str(error))}") from error
    config = _with_absolute_paths(config, file.absolute().parent)
    problem = problem_in(config)
    if problem is not None:
        keys, text = problem
        raise ConfigError(f"{file}: {_place(data, keys)}{_value_shown(data, keys)}: {text}")
    return config, file


def _find(path: Path | None, environ: Mapping[str, str]) -> Path:
    if path is not None:
        return path
    if environ.get(ENVIRONMENT):
        return Path(environ[ENVIRONMENT])
    for candidate in DEFAULT_PATHS:
        if candidate.exists():
            return candidate
    raise ConfigError(
        f"no configuration found: neither --config nor ${ENVIRONMENT} is given, and there is no "
        f"{' or '.join(map(str, DEFAULT_PATHS))}: describe your pads in one of them; the config.toml that ships is an "
        "example"
    )


def _read(file: Path) -> dict[str, Any]:
    try:
        text = file.read_text(encoding="utf-8-sig")  # skips the byte order mark that some editors write
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: is not UTF-8 text (byte {error.start})") from error
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{file}: is not TOML: {error}{_line_shown(text, str(error))}") from error


def _line_shown(text: str, error: str) -> str:
    number = re.search(r"at line (\d+)", error)
    return f": {text.splitlines()[int(number[1]) - 1].strip()}" if number else ""


def _with_absolute_paths(config: Config, folder: Path) -> Config:
    pads = []
    for pad in config.pad:
        if pad.contact.model not in (NO_MODEL, *SHIPPED_PATHS):
            contact = msgspec.structs.replace(pad.contact, model=str(folder / pad.contact.model))
            pad = msgspec.structs.replace(pad, contact=contact)
        if isinstance(pad.source, ReplaySource):
            source = msgspec.structs.replace(pad.source, file=str(folder / pad.source.file))
            pad = msgspec.structs.replace(pad, source=source)
        if isinstance(pad.source, SimulatedSource) and pad.source.mechanics != "standard":
            simulated = msgspec.structs.replace(pad.source, mechanics=str(folder / pad.source.mechanics))
            pad = msgspec.structs.replace(pad, source=simulated)
        pads.append(pad)
    bus = config.bus
    if bus.keys is not None:
        bus = msgspec.structs.replace(bus, keys=str(folder / bus.keys))
    return msgspec.structs.replace(config, pad=tuple(pads), bus=bus)


def _explain(data: dict[str, Any], error: str) -> str:
    """Rewrites msgspec's "what - at `$.pad[0].source.rate_hz`" for a person who edits the file."""
    what, _, path = error.partition(" - at ")
    keys: list[Key] = [int(index) if index else name for name, index in re.findall(r"\.(\w[\w-]*)|\[(\d+)\]", path)]
    if missing := re.search(r"missing required field `(.*)`", what):
        table = _type_at(data, keys)
        return f"{_place(data, [*keys, missing[1]])} is missing: give {_allowed(_field_type(table, missing[1]))}"
    if unknown := re.search(r"unknown field `(.*)`", what):
        return f"{_place(data, [*keys, unknown[1]])}: there is no such key{_nearest(data, keys, unknown[1])}"
    return f"{_place(data, keys)}{_value_shown(data, keys)}: must be {_allowed(_type_at(data, keys))}"


def _nearest(data: dict[str, Any], keys: Sequence[Key], unknown: str) -> str:
    known = [field.name for field in _fields(_type_at(data, keys))]
    near = difflib.get_close_matches(unknown, known, n=1, cutoff=0.5)
    if not near:
        return f" (there are {', '.join(known)})"
    unit = UNITS.get(near[0].rpartition("_")[2])
    return f"; did you mean {near[0]}{f', in {unit}' if unit else ''}?"


def _place(data: dict[str, Any], keys: Sequence[Key]) -> str:
    """The path of a key in words, like `pad 'left' (second [[pad]]): geometry.sensors_mm[1]`."""
    if len(keys) >= 2 and keys[0] == "pad" and isinstance(keys[1], int):
        number = keys[1]
        name = _value_at(data, ["pad", number, "name"])
        ordinal = ORDINALS[number] if number < len(ORDINALS) else f"{number + 1}th"
        who = f"pad {name!r} ({ordinal} [[pad]])" if isinstance(name, str) else f"{ordinal} [[pad]]"
        return f"{who}: {_dotted(keys[2:])}" if len(keys) > 2 else who
    return _dotted(keys) or "the file"


def _dotted(keys: Sequence[Key]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).removeprefix(".")


def _value_at(data: Any, keys: Sequence[Key]) -> Any:
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _value_shown(data: dict[str, Any], keys: Sequence[Key]) -> str:
    value = _value_at(data, keys)
    if value is None or isinstance(value, dict):
        return ""
    return f" = {value if not isinstance(value, str) else repr(value)!s}"[:80]


def _numbers(value: Any, keys: tuple[Key, ...] = ()) -> Iterator[tuple[tuple[Key, ...], float]]:
    if isinstance(value, float):
        yield keys, value
    children: Any = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from _numbers(child, (*keys, key))


def _type_at(data: Any, keys: Sequence[Key]) -> inspect.Type:
    kind: inspect.Type = inspect.type_info(Config)
    for key in keys:
        if isinstance(kind, inspect.UnionType):
            kind = _chosen(kind, data)
        data = _value_at(data, [key])
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
