"""Reads message maps into dataclasses; refuses wrong types, NaN and infinity, and names the field."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Hashable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, Callable, TypeVar, Union, cast, get_args, get_origin, get_type_hints

SCHEMA_VERSION = 1
# Marks a dataclass field that the client adds: it is not in the message.
NOT_SENT = {"sent": False}
# Marks a dataclass field that older daemons do not send: it then keeps its default.
MAY_BE_MISSING = {"may_be_missing": True}

T = TypeVar("T")
Check = Callable[[Any], Any]


class MessageError(ValueError):
    """A message must not be used; the text names the field and its value."""


class SchemaError(MessageError):
    """The daemon uses another version of the schema than this client."""


def check_version(message: Mapping[str, object]) -> None:
    version = message.get("v")
    if version != SCHEMA_VERSION or isinstance(version, bool):
        raise SchemaError(
            f"the daemon sends schema version {reprlib.repr(version)}, this client reads {SCHEMA_VERSION}: "
            "install the fmfts-client that belongs to the daemon"
        )


def parse(kind: type[T], message: object, **not_sent: object) -> T:
    """Read `message` into the dataclass `kind`. not_sent: values of its fields marked NOT_SENT.

    Ignores unknown keys. Raises MessageError for a missing key, a wrong type (True is not a number), NaN and infinity.
    """
    if not isinstance(message, Mapping):
        raise MessageError(f"{kind.__name__}: not a map but {_shown(message)}")
    values: dict[str, Any] = dict(not_sent)
    for name, check, may_be_missing in _checks(cast(Hashable, kind)):
        if name not in message:
            if may_be_missing:
                continue
            raise MessageError(f"{kind.__name__}: {name} is missing")
        try:
            values[name] = check(message[name])
        except MessageError as error:
            raise MessageError(f"{kind.__name__}.{name}: {error}") from None
    return kind(**values)


@cache
def _checks(kind: Any) -> tuple[tuple[str, Check, bool], ...]:
    hints = get_type_hints(kind)
    return tuple(
        (field.name, _check_for(hints[field.name]), field.metadata == MAY_BE_MISSING)
        for field in fields(kind)
        if field.metadata != NOT_SENT
    )


def _check_for(hint: Any) -> Check:
    if get_origin(hint) is Union:  # only Optional[...] is used
        inner = _check_for(next(arg for arg in get_args(hint) if arg is not type(None)))
        return lambda value: None if value is None else inner(value)
    if get_origin(hint) is tuple:
        return _sequence_check(get_args(hint))
    if is_dataclass(hint) and isinstance(hint, type):
        return lambda value: parse(hint, value)
    if hint is float:
        return _number
    return _exactly(dict if get_origin(hint) is dict else hint)


def _number(value: Any) -> float:
    if type(value) not in (float, int) or not math.isfinite(value):
        raise MessageError(f"not a finite number but {_shown(value)}")
    return float(value)


def _exactly(kind: type) -> Check:
    def check(value: Any) -> Any:
        if type(value) is not kind:  # isinstance would accept True as an int
            raise MessageError(f"not {kind.__name__} but {_shown(value)}")
        return value

    return check


def _sequence_check(items: tuple[Any, ...]) -> Check:
    one = _check_for(items[0])
    length = None if items[-1] is Ellipsis else len(items)

    def check(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)) or length not in (None, len(value)):
            raise MessageError(f"not a list of {length if length is not None else 'any'} length but {_shown(value)}")
        return tuple(map(one, value))

    return check


def _shown(value: object) -> str:
    return f"{type(value).__name__} {_short.repr(value)[:60]}"


# repr itself raises RecursionError for a list that is nested a thousand times, and a message may contain one.
_short = reprlib.Repr()
_short.maxstring = _short.maxother = 60
