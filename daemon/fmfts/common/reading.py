"""Reads files that may be damaged in any way, so that each kind of file fails with its own error."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import TextIO

# Systems differ in which of these they have. O_BINARY is Windows', which otherwise translates the ends of lines.
READ_ONLY = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))
LONGEST_QUOTE = 500
LARGEST_TABLE, MOST_COLUMNS = 200_000_000, 1000  # of a CSV file


def open_regular(path: Path) -> BufferedReader:
    """Open a file to read. OSError if it is none: a pipe in its place would make the reader wait for ever."""
    descriptor = os.open(path, READ_ONLY)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "not a file, but a folder, a pipe or a device", str(path))
    return open(descriptor, "rb")


def read_regular(path: Path, most_bytes: int) -> bytes:
    """The content of a file, at most `most_bytes` of it. OSError as from `open_regular`."""
    with open_regular(path) as file:
        return file.read(most_bytes)


def open_text(path: Path) -> TextIO:
    """Open a table of text, with any newline. OSError as from `open_regular`, or where it is larger than any table."""
    file = open_regular(path)
    if os.fstat(file.fileno()).st_size > LARGEST_TABLE:
        file.close()
        raise OSError(errno.EFBIG, f"larger than {LARGEST_TABLE / 1e6:g} MB: divide it", str(path))
    return io.TextIOWrapper(file, encoding="utf-8-sig", newline="")  # skips the byte order mark of some spreadsheets


def digest_of(path: Path) -> str:
    """The SHA-256 of a file, in hex. OSError as from `open_regular`."""
    digest = hashlib.sha256()
    with open_regular(path) as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


@contextmanager
def damage_told(named: type[Exception], sentence: str, remedy: str = "") -> Iterator[None]:
    """Every error inside becomes `named`, with `sentence`, the cause, and what to do. `named` itself passes.

    A decoder may raise any error for damaged bytes, so no list of its errors is ever complete.
    """
    try:
        yield
    except named:
        raise
    except Exception as error:
        mend = f": {remedy}" if remedy else ""
        raise named(f"{sentence} ({type(error).__name__}: {shortened(str(error))}){mend}") from error


@contextmanager
def unreadable_told(named: type[Exception], whose: object, remedies: Mapping[int, str] | None = None) -> Iterator[None]:
    """An OSError inside becomes `named`: `whose` cannot be read. remedies: what to do, by the error's number."""
    try:
        yield
    except OSError as error:
        remedy = (remedies or {}).get(error.errno or 0, "")
        raise named(f"{whose}: cannot be read: {error.strerror}{remedy and ': '}{remedy}") from error


def shortened(text: str) -> str:
    """The text for an error's sentence: a decoder may quote all of a file in its own."""
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}…"
