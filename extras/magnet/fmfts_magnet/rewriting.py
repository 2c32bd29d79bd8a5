"""Changes keys of one pad's [pad.geometry] in a configuration file. All other lines and comments stay."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from fmfts.common.toml import parse
from fmfts.config.file import ConfigError, load

PAD = re.compile(r"^\s*\[\[\s*pad\s*\]\]")
TABLE = re.compile(r"^\s*\[\[?\s*[A-Za-z_][\w.\s-]*\]\]?\s*(?:#|\Z)")  # but not a row of a list
OF_PAD = re.compile(r"^\s*\[\[?\s*pad\s*\.")
GEOMETRY = re.compile(r"^\s*\[\s*pad\s*\.\s*geometry\s*\]")


class RewritingError(Exception):
    """The file is unchanged; the text says why, and what to write by hand."""


def with_geometry(text: str, pad: str, values: Mapping[str, str]) -> str:
    """The file's text with these keys of the pad's geometry; values are TOML. Raises RewritingError.

    `board` stands for places and rotations: the text has either `board` or those.
    """
    due = parse(text)
    numbers = [number for number, table in enumerate(due["pad"]) if table.get("name") == pad]
    written = parse("\n".join(f"{key} = {value}" for key, value in values.items()))
    without = {"sensors_mm", "sensor_rotations_deg"} if "board" in values else {"board"}
    before = due["pad"][numbers[0]].get("geometry", {})
    due["pad"][numbers[0]]["geometry"] = {key: before[key] for key in before if key not in without} | written
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines) if PAD.match(line)]
    by_hand = "write this by hand: " + "; ".join(f"{key} = {value}" for key, value in values.items())
    if len(starts) == len(due["pad"]):
        changed = _changed(lines, starts[numbers[0]], dict.fromkeys(before.keys() & without) | dict(values))
        result = "\n".join(changed) + "\n"
        if _read(result) == due:
            return result
    raise RewritingError(
        f"the table [pad.geometry] of pad '{pad}' is written in a way that is not understood: {by_hand}"
    )


def rewrite(path: Path, text: str) -> Path:
    """Replaces the file at once, and keeps the old one beside it; returns where.

    Raises RewritingError where the daemon would refuse the new text, and OSError.
    """
    names = (path.with_name(f"{path.name}.bak{number if number > 1 else ''}") for number in count(1))
    kept = next(name for name in names if not name.exists())
    new = path.with_name(path.name + ".new")
    try:
        new.write_text(text, encoding="utf-8")
        shutil.copymode(path, new)
        load(new)
        shutil.copy2(path, kept)
        os.replace(new, path)
    except ConfigError as error:
        raise RewritingError(f"the new text would be refused: {str(error).replace(str(new), str(path))}") from error
    finally:
        new.unlink(missing_ok=True)
    return kept


def _read(text: str) -> dict[str, Any] | None:
    try:
        return parse(text)
    except ValueError:
        return None


def _changed(lines: list[str], start: int, values: Mapping[str, str | None]) -> list[str]:
    """The lines with these keys in the geometry of the pad that begins at `start`; None removes a key."""
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


def _with_value(table: list[str], key: str, value: str | None) -> list[str]:
    at = next((number for number, line in enumerate(table) if re.match(rf"\s*{key}\s*=", line)), None)
    if at is None:
        return table if value is None else [f"{key} = {value}", *table]
    # A list may continue on several lines.
    last = next(
        (last for last in range(at, len(table)) if _read("\n".join(table[at : last + 1])) is not None), len(table) - 1
    )
    if value is None:
        return [*table[:at], *table[last + 1 :]]
    comment = table[last].partition("#")[2]
    line = f"{key} = {value}"
    return [*table[:at], line.ljust(30) + f" #{comment}" if comment else line, *table[last + 1 :]]
