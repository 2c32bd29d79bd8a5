"""The package with its C under AddressSanitizer and UndefinedBehaviorSanitizer, in build/sanitized.

The checkout's own compiled parts stay as they are: build/sanitized/fmfts links to every Python file of the package, and
has compiled parts of its own.
"""

from __future__ import annotations

import os
import runpy
import subprocess
import sysconfig
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from fmfts.common.toml import parse

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build/sanitized"
# GCC's `undefined` leaves out a number that does not fit into an integer: NaN as an index makes C read far away.
CHECKS = "-fsanitize=address,undefined,float-cast-overflow"
SANITIZED = [CHECKS, "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g", "-O1"]
SUFFIX = ".abi3.so"
FLAGS: list[str] = runpy.run_path(str(ROOT / "setup.py"))["FLAGS"]


def compiled(sources: Sequence[Path], library: Path, flags: Sequence[str] = ("-std=c11",)) -> Path:
    """A module for Python of these sources. Raises RuntimeError with what the compiler said."""
    include = sysconfig.get_path("include")
    command = ["gcc", "-shared", "-fPIC", *flags, *SANITIZED, f"-I{include}", *sources, "-lm", "-o", library]
    library.parent.mkdir(parents=True, exist_ok=True)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RuntimeError(f"{library.name} does not compile under the sanitizers:\n{ended.stderr}")
    return library


def parts() -> list[dict[str, Any]]:
    """The compiled parts that pyproject.toml names."""
    modules: list[dict[str, Any]] = parse((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"]
    return modules


def library_of(part: dict[str, Any]) -> Path:
    return BUILD / (part["name"].replace(".", "/") + SUFFIX)


def flags_of(part: dict[str, Any]) -> list[str]:
    """The package's flags without its optimisation, which removes errors that should be caught."""
    flags = *FLAGS, *part.get("extra-compile-args", ())
    return [flag for flag in flags if not flag.startswith("-O")]


def build_part(part: dict[str, Any]) -> None:
    library, sources = library_of(part), [ROOT / name for name in part["sources"]]
    needed = [*sources, *(ROOT / "daemon").rglob("*.h"), ROOT / "pyproject.toml", Path(__file__)]
    if library.exists() and library.stat().st_mtime > max(file.stat().st_mtime for file in needed):
        return
    compiled(sources, library, flags_of(part))


def link_python() -> None:
    """Makes build/sanitized/fmfts a copy of daemon/fmfts without compiled parts."""
    package, here = ROOT / "daemon/fmfts", BUILD / "fmfts"
    for link in here.rglob("*"):
        if link.is_symlink():
            link.unlink()
    for folder, folders, files in os.walk(package):
        folders[:] = [name for name in folders if name != "__pycache__"]
        (here / Path(folder).relative_to(package)).mkdir(parents=True, exist_ok=True)
        for name in files:
            if not name.endswith(".so"):
                original = Path(folder, name)
                (here / original.relative_to(package)).symlink_to(original)


def build() -> None:
    link_python()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(build_part, parts()))


def environment() -> dict[str, str]:
    """Environment in which Python runs the package under the sanitizers.

    Python keeps memory until it ends, so leaks are not searched; and its own allocator hides the ends of small objects
    from the sanitizer, so malloc replaces it.
    """
    libraries = [
        subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
        for name in ("libasan.so", "libubsan.so")
    ]
    return os.environ | {
        "LD_PRELOAD": " ".join(libraries),
        "PYTHONMALLOC": "malloc",
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1:detect_stack_use_after_return=1:strict_string_checks=1",
        "UBSAN_OPTIONS": "print_stacktrace=1:halt_on_error=1:abort_on_error=1",
        "PYTHONPATH": os.pathsep.join([str(BUILD), str(ROOT / "tests"), str(ROOT / "tests/unit")]),
    }
