"""What pyproject.toml cannot say: which Pythons a wheel serves, what to install where it cannot be built, and which
headers a compiled part includes, so that a changed one compiles it anew and all of them are in the source archive; and
with which flags each of them is compiled.

The stable ABI of Python 3.11 serves every later one (common/stable_abi.h). A wheel that 3.10 builds serves 3.10 alone.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path

from setuptools import setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CCompilerError, CompileError, ExecError, PlatformError

NOT_COMPILED = (
    "fmfts is compiled as it is installed, and that failed ({error}): install a C compiler and Python's headers "
    "(Debian: sudo apt-get install gcc libc6-dev python3-dev), or a wheel of fmfts that was built for this computer"
)


ROOT = Path(__file__).parent
# No contraction: every machine computes the same.
FLAGS = ["-std=c11", "-O3", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror=implicit-function-declaration"]


def headers(sources: Iterable[str]) -> list[str]:
    """All that these files of the checkout include, and what those include."""
    found: set[Path] = set()
    to_read = [(ROOT / name).resolve() for name in sources]
    while to_read:
        path = to_read.pop()
        named = re.findall(r'^#include "([^"]+)"', path.read_text(encoding="utf-8"), re.MULTILINE)
        new = {(path.parent / name).resolve() for name in named} - found
        found |= new
        to_read.extend(new)
    return sorted(path.relative_to(ROOT.resolve()).as_posix() for path in found)


class BuildExtensions(build_ext):
    """Its last line says what to install."""

    def finalize_options(self) -> None:
        super().finalize_options()
        for part in self.extensions or ():
            part.depends = headers(part.sources)
            part.extra_compile_args = list(dict.fromkeys([*FLAGS, *part.extra_compile_args]))

    def build_extensions(self) -> None:
        try:
            super().build_extensions()
        except (CCompilerError, ExecError, PlatformError) as error:
            raise CompileError(NOT_COMPILED.format(error=error)) from error


if __name__ == "__main__":
    setup(
        cmdclass={"build_ext": BuildExtensions},
        options={"bdist_wheel": {"py_limited_api": "cp311"}} if sys.version_info >= (3, 11) else {},
    )
