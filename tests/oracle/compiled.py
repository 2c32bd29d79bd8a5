"""Steps of the product that no binding exports, compiled as a separate library from the imported package's sources."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import fmfts
from fmfts.common.record import Record
from fmfts.pipeline._pad import MEMORY
from needed import missing
from oracle.field import Array

PACKAGE = Path(fmfts.__file__).parent
FLAGS = ("-std=c11", "-O1", "-shared", "-fPIC", "-ffp-contract=off", "-fno-math-errno")


def library_of(folder: Path, *sources: str) -> ctypes.CDLL:
    """sources: in the package."""
    if shutil.which("cc") is None:
        missing("cc")
    library = folder / "oracle.so"
    subprocess.run(["cc", *FLAGS, *(PACKAGE / source for source in sources), "-lm", "-o", library], check=True)
    return ctypes.CDLL(str(library))


def pointer(numbers: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(numbers.ctypes.data)


def part_of(record: Record) -> ctypes.c_void_p:
    """A record as C takes it."""
    return ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(record.buffer)))


def memory_between(first: str, last: str) -> Record:
    """One struct of a pad's memory, from its first to its last of these fields."""
    names = [name for name, _, _ in MEMORY]
    fields: Sequence[tuple[str, str, int]] = MEMORY[names.index(first) : names.index(last) + 1]
    return Record(fields)
