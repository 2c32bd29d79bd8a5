"""Prints facts for a person (in millimetres, milligauss and degrees) or for a program (JSON, SI units)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any, NamedTuple


class Unit(NamedTuple):
    name: str
    factor: float
    decimals: int  # as many as the measurement is accurate to


PLAIN = Unit("", 1.0, 4)
# Suffix of a key → the unit that a person reads.
UNITS = {
    "_remanence_t": Unit("T", 1.0, 4),
    "_remanence_sd_t": Unit("T", 1.0, 4),
    "_m": Unit("mm", 1e3, 3),
    "_t": Unit("mG", 1e7, 2),
    "_rad": Unit("°", math.degrees(1.0), 2),
    "_s": Unit("s", 1.0, 2),
    "_c": Unit("°C", 1.0, 1),
}
HEXADECIMAL = ("address",)  # keys whose value is written as boards and data sheets do


def print_facts(facts: dict[str, Any], as_json: bool) -> None:
    print(json.dumps(facts, indent=1) if as_json else "\n".join(_lines(facts)))


def _lines(facts: dict[str, Any], indent: str = "") -> Iterator[str]:
    for key, value in facts.items():
        if value in ("", {}):
            continue
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from _lines(value, indent + "  ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
            for number, entry in enumerate(value):
                yield from [""] if number else []
                yield from _lines(entry, indent)
        else:
            name, text = _readable(key, value)
            yield f"{indent}{name}: {text}"


def _readable(key: str, value: Any) -> tuple[str, str]:
    if key.endswith(HEXADECIMAL) and isinstance(value, int):
        return key.replace("_", " "), f"{value:#04x}"
    suffix = next((suffix for suffix in UNITS if f"_{key}".endswith(suffix)), "")
    unit = UNITS.get(suffix, PLAIN)
    name = key[: key.rindex("_")] if suffix else key
    return name.replace("_", " "), f"{_number(value, unit)} {unit.name}".strip()


def _number(value: Any, unit: Unit) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "–"}[value]
    if isinstance(value, float):
        return f"{round(value * unit.factor, unit.decimals) + 0.0:.{unit.decimals}f}"  # + 0.0 turns −0 into 0
    if isinstance(value, list | tuple) and value and isinstance(value[0], str):
        return "; ".join(value)
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_number(entry, unit) for entry in value) + ")" if value else "none"
    return str(value)
