"""Prints facts for a person (in millimetres, microtesla and degrees) or for a program (JSON, SI units)."""

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
    "_remanences_t": Unit("T", 1.0, 4),
    "_remanence_sd_t": Unit("T", 1.0, 4),
    "_m": Unit("mm", 1e3, 3),
    "_t": Unit("µT", 1e6, 3),
    "_n": Unit("N", 1.0, 3),
    "_um": Unit("µm", 1.0, 1),
    "_rad": Unit("°", math.degrees(1.0), 2),
    "_s": Unit("s", 1.0, 2),
    "_c": Unit("°C", 1.0, 1),
}
# Keys that need more words for a person, with the unit's place in the sentence.
LABELS = {
    "gain_sd": "gains, relative to each other",
    "largest_zero_t": "largest good zero",
    "zero_t": "zero of each axis",
    "coil_t": "moved by its own coil",
    "sensor_place_sd_m": "places of the sensors",
    "press_1n_sideways_sd_m": "press of 1 N: magnet's way sideways",
    "press_1n_force_sd_n": "press of 1 N: force, without the silicone's stiffness",
    "middle_1n_place_sd_m": "press of 1 N in the middle: place",
    "middle_1n_force_sd_n": "press of 1 N in the middle: force",
    "with_bare": "with a bare recording",
    "chi2": "χ² of the fit",
    "stiffness": "stiffness, times the model's",
    "stiffness_sd": "its deviation",
    "missed_contacts": "missed contacts (this computer was too slow)",
    "unreplayed": "contacts not replayed",
    "without_their_other": "contacts at the ends, in the recording or the replay alone",
    "warnings": "beware",
    "could_gain": "the magnet's way in a press of 1 N could be known better",
}
SILENT_IF_EMPTY = ("could_gain", "warnings")
HEXADECIMAL = ("address",)  # keys whose value is written as boards and data sheets do


def print_facts(facts: dict[str, Any], as_json: bool) -> None:
    print(json.dumps(facts, indent=1) if as_json else "\n".join(fact_lines(facts)))


def fact_lines(facts: dict[str, Any]) -> list[str]:
    """The facts as a person reads them, a line for each."""
    return list(_lines(facts))


def _lines(facts: dict[str, Any], indent: str = "") -> Iterator[str]:
    for key, value in facts.items():
        if value in ("", {}) or (value == [] and key in SILENT_IF_EMPTY) or key.startswith("was_"):
            continue
        if key.startswith("now_"):
            yield indent + _gained(key.removeprefix("now_"), facts)
            continue
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from _lines(value, indent + "  ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
            for number, entry in enumerate(value):
                yield from [""] if number else []
                yield from _lines(entry, indent)
        elif isinstance(value, list | tuple) and len(value) > 1 and all(isinstance(entry, str) for entry in value):
            yield f"{indent}{_readable(key, None)[0]}:"
            yield from (f"{indent}  {entry}" for entry in value)
        else:
            name, text = _readable(key, value)
            yield f"{indent}{name}: {text}"


def _gained(key: str, facts: dict[str, Any]) -> str:
    """A deviation after `--turn` or `--refine`, beside the one before."""
    _, now = _readable(key, facts[f"now_{key}"])
    was = "" if facts.get(f"was_{key}") is None else f" (was ± {_readable(key, facts[f'was_{key}'])[1]})"
    return f"{LABELS.get(key) or _readable(key, 0.0)[0].removesuffix(' sd')}: ± {now}{was}"


def _readable(key: str, value: Any) -> tuple[str, str]:
    if key.endswith(HEXADECIMAL) and isinstance(value, int):
        return key.replace("_", " "), f"{value:#04x}"
    suffix = next((suffix for suffix in UNITS if f"_{key}".endswith(suffix)), "")
    unit = UNITS.get(suffix, PLAIN)
    name = LABELS.get(key) or (key[: key.rindex("_")] if suffix else key)
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
