"""Holds JSON to its schema. jsonschema takes two seconds of a processor to import, so that only its users import it."""

from __future__ import annotations

from functools import cache
from typing import Any

import msgspec


def fits(content: Any, schema: dict[str, Any]) -> bool:
    """True if it fits; prints why it does not."""
    checked = _validator(msgspec.json.encode(schema))
    for error in checked.iter_errors(content):
        print(error)
    return bool(checked.is_valid(content))


@cache
def _validator(schema: bytes) -> Any:
    from jsonschema import Draft202012Validator

    described = msgspec.json.decode(schema)
    Draft202012Validator.check_schema(described)
    return Draft202012Validator(described)
