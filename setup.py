"""What pyproject.toml cannot say: which Pythons a wheel serves, and what to install where it cannot be built.

The stable ABI of Python 3.11 serves every later one (common/stable_abi.h). A wheel that 3.10 builds serves 3.10 alone.
"""

import sys

from setuptools import setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CCompilerError, CompileError, ExecError, PlatformError

NOT_COMPILED = (
    "fmfts is compiled as it is installed, and that failed ({error}): install a C compiler and Python's headers "
    "(Debian: sudo apt-get install gcc libc6-dev python3-dev), or a wheel of fmfts that was built for this computer"
)


class BuildExtensions(build_ext):
    """Its last line says what to install."""

    def build_extensions(self) -> None:
        try:
            super().build_extensions()
        except (CCompilerError, ExecError, PlatformError) as error:
            raise CompileError(NOT_COMPILED.format(error=error)) from error


setup(
    cmdclass={"build_ext": BuildExtensions},
    options={"bdist_wheel": {"py_limited_api": "cp311"}} if sys.version_info >= (3, 11) else {},
)
