"""The sentence for an unknown name, with the known ones and the most similar one; names of columns."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches


def no_such_pad(name: str | None, known: Sequence[str], where: str) -> str:
    """name: the pad that was asked for; None: none was named. where: who has the pads `known`."""
    quoted = ", ".join(f"'{one}'" for one in known) or "no pad at all"
    if name is None:
        return f"which pad? {where} has {quoted}: say --pad NAME"
    nearest = get_close_matches(name, known, n=1)
    meant = f"; did you mean '{nearest[0]}'?" if nearest else ""
    return f"no pad '{name}' here; {where} has {quoted}{meant}"


def field_columns(sensors: int) -> list[str]:
    """The columns of a CSV file of fields in µT, with the sensors in the order of the configuration."""
    return [f"b{sensor}{axis}_ut" for sensor in range(1, sensors + 1) for axis in "xyz"]
