"""Parses TOML within limits, because its author is not trusted: tomllib takes minutes for a key of many parts."""

from __future__ import annotations

import re
import sys
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LARGEST_BYTES = 200_000  # bytes: the configuration of 64 pads has 100,000
MOST_PARTS = 32  # of one dotted key
NotToml = tomllib.TOMLDecodeError
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}){{{MOST_PARTS}}}", re.ASCII)


def parse(text: str) -> dict[str, Any]:
    """The tables of a text. NotToml or another ValueError where it is no TOML, or exceeds a limit."""
    if len(text) > LARGEST_BYTES:
        raise ValueError(f"it is longer than {LARGEST_BYTES} bytes")
    if (long := _LONG_KEY.search(text)) is not None:
        raise ValueError(f"{long[0][:20]!r} begins a key of more than {MOST_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its lists or tables are nested too deep") from None
