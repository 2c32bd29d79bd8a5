"""Which kind of set or model a file is, by its first bytes, before anything heavy is imported."""

from __future__ import annotations

from pathlib import Path

from fmfts.common.reading import read_regular

HEADER_BYTES, MARK_WITHIN = 10_000, 64


def columns_of(data: Path) -> set[str]:
    """Column names of a CSV file; empty if it cannot be read: the reader that follows reports why."""
    try:
        header = read_regular(data, HEADER_BYTES).split(b"\n", 1)[0].decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return set()
    return {name.strip(' "\r') for name in header.split(",")}


def begins_with(model: Path, mark: bytes) -> bool:
    """Whether the first bytes have the mark; False where the file cannot be read."""
    try:
        return mark in read_regular(model, MARK_WITHIN)
    except OSError:
        return False
