"""Changes keys of one pad's [pad.geometry] in a configuration file. All other lines and comments stay."""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PAD = re.compile(r"^\s*\[\[\s*pad\s*\]\]")
TABLE = re.compile(r"^\s*\[\[?\s*[A-Za-z_][\w.\s-]*\]\]?\s*(?:#|$)")  # and no row of a list
OF_PAD = re.compile(r"^\s*\[\[?\s*pad\s*\.")
GEOMETRY = re.compile(r"^\s*\[\s*pad\s*\.\s*geometry\s*\]")


class RewritingError(Exception):
    """The file is left as it was; the text says why, and what to write by hand."""


def with_geometry(text: str, pad: str, values: Mapping[str, str]) -> str:
    """The file's text with these keys of the pad's geometry; values are TOML. Raises RewritingError."""
    due = tomllib.loads(text)
    numbers = [number for number, table in enumerate(due["pad"]) if table.get("name") == pad]
    written = tomllib.loads("\n".join(f"{key} = {value}" for key, value in values.items()))
    due["pad"][numbers[0]]["geometry"] = due["pad"][numbers[0]].get("geometry", {}) | written
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if PAD.match(line)]
    by_hand = "write this by hand: " + "; ".join(f"{key} = {value}" for key, value in values.items())
    if len(starts) == len(due["pad"]):
        changed = _changed(lines, starts[numbers[0]], values)
        result = "\n".join(changed) + "\n"
        if _read(result) == due:
            return result
    raise RewritingError(
        f"the table [pad.geometry] of pad '{pad}' is written in a way that is not understood: {by_hand}"
    )


def rewrite(path: Path, text: str) -> Path:
    """Replaces the file at once, and keeps the old one beside it; returns where. Raises OSError."""
    kept = path.with_name(path.name + ".bak")
    shutil.copy2(path, kept)
    new = path.with_name(path.name + ".new")
    try:
        new.write_text(text, encoding="utf-8")
        shutil.copymode(path, new)
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)
    return kept


def _read(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _changed(lines: list[str], start: int, values: Mapping[str, str]) -> list[str]:
    end = start + 1
    while end < len(lines) and not (TABLE.match(lines[end]) and not OF_PAD.match(lines[end])):
        end += 1
    headers = [number for number in range(start, end) if GEOMETRY.match(lines[number])]
    if not headers:
        last = end
        while last > start and (not lines[last - 1].strip() or lines[last - 1].lstrip().startswith("#")):
            last -= 1
        return [
            *lines[:last],
            "",
            "[pad.geometry]",
            *(f"{key} = {value}" for key, value in values.items()),
            *lines[last:],
        ]
    first = headers[0] + 1
    until = next((number for number in range(first, end) if TABLE.match(lines[number])), end)
    table = lines[first:until]
    for key, value in reversed(list(values.items())):
        table = _with_value(table, key, value)
    return [*lines[:first], *table, *lines[until:]]


def _with_value(table: list[str], key: str, value: str) -> list[str]:
    at = next((number for number, line in enumerate(table) if re.match(rf"\s*{key}\s*=", line)), None)
    if at is None:
        return [f"{key} = {value}", *table]
    # A list may go on for several lines.
    last = next(
        (last for last in range(at, len(table)) if _read("\n".join(table[at : last + 1])) is not None), len(table) - 1
    )
    comment = table[last].partition("#")[2]
    line = f"{key} = {value}"
    return [*table[:at], line.ljust(30) + f" #{comment}" if comment else line, *table[last + 1 :]]
