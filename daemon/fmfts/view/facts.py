"""Facts for a person (units as in a workshop) or for a program (JSON, SI)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

# Suffix of a key → what a person reads: unit and factor. Millimetres and gauss only where a person looks.
UNITS = {"_m": ("mm", 1e3), "_t": ("mG", 1e7), "_rad": ("°", 57.29577951308232), "_s": ("s", 1.0), "_c": ("°C", 1.0)}
EXCEPTIONS = {"remanence_t": ("T", 1.0), "remanence_sd_t": ("T", 1.0)}


def print_facts(facts: dict[str, Any], as_json: bool) -> None:
    print(json.dumps(facts, indent=1) if as_json else "\n".join(_lines(facts)))


def _lines(facts: dict[str, Any], indent: str = "") -> Iterator[str]:
    for key, value in facts.items():
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from _lines(value, indent + "  ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
            for entry in value:
                yield from _lines(entry, indent)
                yield ""
        else:
            name, text = _readable(key, value)
            yield f"{indent}{name}: {text}"


def _readable(key: str, value: Any) -> tuple[str, str]:
    unit, factor = EXCEPTIONS.get(key) or next((UNITS[end] for end in UNITS if key.endswith(end)), ("", 1.0))
    name = key[: key.rindex("_")] if unit else key
    return name.replace("_", " "), f"{_number(value, factor)} {unit}".strip()


def _number(value: Any, factor: float) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "–"}[value]
    if isinstance(value, float):
        return f"{value * factor:.4g}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_number(entry, factor) for entry in value) + ")"
    return str(value)
