"""JSON schemas that other programs read, of the messages in a recording.

Foxglove reads only schemas of a plain form: an object, whose properties have one type each, without references. So a
field that may be null is omitted from a recorded message if it is null, instead of having two types.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec

Schema = dict[str, Any]
Change = Callable[[dict[str, Any], type[msgspec.Struct]], dict[str, Any]]


@cache
def plain_schema(kind: type[msgspec.Struct]) -> Schema:
    """The schema of `kind` in that form. Lists of lists are left out: a plain schema cannot describe them."""
    whole = msgspec.json.schema(kind)
    plain = _plain(whole, whole.get("$defs", {}))
    assert plain is not None
    return plain | {"title": kind.__name__}


def _plain(schema: Schema, definitions: dict[str, Schema]) -> Schema | None:
    """None for a type that cannot be described."""
    if "$ref" in schema:
        return _plain(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in schema:
        (other,) = [each for each in schema["anyOf"] if each != {"type": "null"}]
        return _plain(other, definitions)
    if "enum" in schema:
        words = [word for word in schema["enum"] if word is not None]
        return {"type": "string", "enum": words} if all(isinstance(word, str) for word in words) else None
    if schema.get("type") == "object":
        found = {name: _plain(each, definitions) for name, each in schema.get("properties", {}).items()}
        optional = {name for name, each in schema.get("properties", {}).items() if _may_be_null(each)}
        required = [name for name in schema.get("required", []) if name not in optional]
        properties = {name: each for name, each in found.items() if each is not None}
        return {"type": "object", "properties": properties, "required": required}
    if schema.get("type") == "array":
        item = schema.get("items") or schema.get("prefixItems", [{}])[0]
        item = _plain(item, definitions) if item is not False else None
        lengths: Schema = {name: schema[name] for name in ("minItems", "maxItems") if name in schema}
        return None if item is None or item["type"] == "array" else {"type": "array", "items": item, **lengths}
    kept: Schema = {name: schema[name] for name in ("type", "contentEncoding", "minimum", "maximum") if name in schema}
    return kept if isinstance(kept.get("type"), str) else None


def _may_be_null(schema: Schema) -> bool:
    return {"type": "null"} in schema.get("anyOf", ()) or None in schema.get("enum", ())


def without_nulls(body: dict[str, Any], kind: type[msgspec.Struct]) -> dict[str, Any]:
    """A message in its plain schema: without null keys, also in its structs."""
    return {name: value for name, value in _in_structs(body, kind, without_nulls).items() if value is not None}


def with_nulls(body: dict[str, Any], kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The inverse of without_nulls; leaves a message that has its nulls as it is."""
    absent = _nullable(kind)
    if not any(name in body for name in _may_be_left_out(kind)):
        absent = tuple(name for name in absent if name not in _may_be_left_out(kind))
    return dict.fromkeys(absent) | _in_structs(body, kind, with_nulls)


def _in_structs(body: dict[str, Any], kind: type[msgspec.Struct], change: Change) -> dict[str, Any]:
    """`body` with all its structs, and those in its lists, changed."""
    nested = _structs_in(kind)
    return {name: _changed(value, nested[name], change) if name in nested else value for name, value in body.items()}


def _changed(value: Any, kind: type[msgspec.Struct], change: Change) -> Any:
    if isinstance(value, dict):
        return change(value, kind)
    return [_changed(each, kind, change) for each in value] if isinstance(value, list) else value


@cache
def _nullable(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    return tuple(each.encode_name for each in _fields(kind) if _has(each.type, msgspec.inspect.NoneType))


@cache
def _may_be_left_out(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """The keys that only messages of one sort have: all of them, of which at least one is never null, or none.

    A map that is never null (`slip`) is a sort of its own: present or absent.
    """
    alone = set(_structs_in(kind)) - set(_nullable(kind))
    fields = msgspec.structs.fields(kind)
    return tuple(each.encode_name for each in fields if each.default is msgspec.UNSET and each.encode_name not in alone)


@cache
def _structs_in(kind: type[msgspec.Struct]) -> dict[str, type[msgspec.Struct]]:
    found = {}
    for each in _fields(kind):
        for one in getattr(each.type, "types", (each.type,)):
            item = getattr(one, "item_type", one)
            if isinstance(item, msgspec.inspect.StructType):
                found[each.encode_name] = item.cls
    return found


def _fields(kind: type[msgspec.Struct]) -> tuple[msgspec.inspect.Field, ...]:
    described = msgspec.inspect.type_info(kind)
    assert isinstance(described, msgspec.inspect.StructType)
    return described.fields


def _has(one: msgspec.inspect.Type, wanted: type[msgspec.inspect.Type]) -> bool:
    return any(isinstance(each, wanted) for each in getattr(one, "types", (one,)))
