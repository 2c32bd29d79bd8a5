"""docs/configuration.md says when to set each key of the configuration."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from msgspec import inspect

from fmfts_collect.settings import CollectingConfig

PAGE = Path(__file__).parents[2] / "docs" / "configuration.md"
IN_TABLES_OF_THE_FIRST = "other_magnets"  # [[pad.magnet]], like the first one


def keys_of(kind: inspect.Type, path: str = "") -> Iterator[str]:
    """Each key of a table and of those within, as pad.source.rate_hz."""
    kind = kind.item_type if isinstance(kind, inspect.VarTupleType) else kind
    kinds = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    tables = [each for each in kinds if isinstance(each, inspect.StructType)]
    if not tables:
        yield path
    for table in tables:
        if table.tag is not None:
            yield f"{path}.type"
        for field in table.fields:
            if field.name != IN_TABLES_OF_THE_FIRST:
                yield from keys_of(field.type, f"{path}.{field.name}".removeprefix("."))


def keys_listed() -> Iterator[str]:
    table = ""
    for line in PAGE.read_text().splitlines():
        if heading := re.match(r"## \[+([\w.]+)\]+$", line):
            table = heading[1]
        elif row := re.match(r"- `(\w+)`: \S.+$", line):
            yield f"{table}.{row[1]}"


def test_page_says_once_when_to_set_each_key() -> None:
    listed, keys = list(keys_listed()), set(keys_of(inspect.type_info(CollectingConfig)))
    assert {"pad.source.clock_hz", "bus.endpoint", "collect.stage.step_mm"} <= keys, "the walk finds the keys"
    assert len(listed) == len(set(listed)), "a key is listed twice"
    assert set(listed) == keys


def test_page_counts_the_keys() -> None:
    keys = set(keys_of(inspect.type_info(CollectingConfig)))
    of_collect = {key for key in keys if key.startswith("collect.")}
    assert f"{len(keys - of_collect)} keys are the daemon's, {len(of_collect)} those of `collect`." in PAGE.read_text()
