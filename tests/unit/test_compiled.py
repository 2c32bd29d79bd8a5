"""The compiled parts that are tested must be those of today's sources."""

from __future__ import annotations

import importlib
import re
import runpy
import shutil
import sysconfig
from pathlib import Path

import pytest

from fmfts.common.toml import parse

ROOT = Path(__file__).parents[2]
PARTS = parse((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"]


def headers(part: dict) -> set[Path]:
    """All that its sources include, and what those include."""
    found: set[Path] = set()
    for name in part["sources"]:
        included((ROOT / name).resolve(), found)
    return found


def included(path: Path, found: set[Path]) -> set[Path]:
    for name in re.findall(r'^#include "([^"]+)"', path.read_text(), re.MULTILINE):
        header = (path.parent / name).resolve()
        if header not in found:
            found.add(header)
            included(header, found)
    return found


@pytest.mark.skipif(
    shutil.which("cc") is None or not (Path(sysconfig.get_path("include")) / "Python.h").exists(),
    reason="there is no C compiler, or no Python.h",
)
@pytest.mark.parametrize("part", PARTS, ids=[part["name"] for part in PARTS])
def test_all_compilable_files_were_compiled(part: dict) -> None:
    library = Path(importlib.import_module(part["name"]).__file__ or "")
    if ROOT not in library.parents:
        return  # installed from a wheel, which is refused where a part is missing
    sources = [ROOT / name for name in part["sources"]] + sorted(headers(part))
    newer = [source.name for source in sources if source.stat().st_mtime > library.stat().st_mtime]
    assert not newer, f"{library.name} is older than {newer}: install again, and look for what the compiler said"


def test_setup_finds_the_headers_that_a_part_includes() -> None:
    """An installation compiles a part anew if one of them has changed, and the source archive has them all."""
    pytest.importorskip("setuptools")
    setup = runpy.run_path(str(ROOT / "setup.py"))
    for part in PARTS:
        assert setup["headers"](part["sources"]) == sorted(str(path.relative_to(ROOT)) for path in headers(part))
    named = {path for part in PARTS for path in headers(part)}
    assert set((ROOT / "daemon").resolve().rglob("*.h")) == named
