"""What is computed between a frame and a message is computed by fmfts.arithmetic alone: the same on every processor."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import fmfts
import fmfts_skin
from fmfts_recording.replay import Replay

PACKAGE = Path(fmfts.__file__).parent
RECORDINGS = sorted((Path(__file__).parents[1] / "data" / "recordings").glob("*.mcap"))
# Everything from the configuration and a baseline's file on that a message depends on.
ROOMS = ["baseline", "common", "config", "contact", "several", "pipeline", "pose", "runtime", "scene", "sensor"]
FILES = ["pad.py"]
SKIN = Path(fmfts_skin.__file__).parent  # its modules, without the folder that makes models
ELSEWHERE = {"weighing.py"}  # measures a value that the baseline's file then keeps as a number, as a scale would
# Functions of NumPy and math that move numbers, compare them, or round as IEEE 754 defines: + − × ÷ √ in a fixed order.
# Not BLAS, LAPACK, functions with wide vectors, nor the C library's functions: each rounds as the processor chooses.
EXACT_NAMES = """
abs all any append arange argmax argmin argsort array array_equal array_split asarray ascontiguousarray block bool_
broadcast_to ceil clip column_stack concatenate copysign count_nonzero deg2rad degrees delete diag diagonal diff dist
dtype empty empty_like errstate eye finfo flatnonzero float32 float64 frombuffer full full_like generic hstack inf
int16 int32 int64 intp isfinite isin isnan ix_ linspace max maximum mean median meshgrid min minimum moveaxis nan
nan_to_num nanmean nanmedian ndarray ones ones_like outer packbits pi prod ptp r_ radians random ravel repeat round
searchsorted sqrt stack sum tile trace uint16 uint8 unique unravel_index where zeros
"""
EXACT = set(EXACT_NAMES.split())
# Degrees in a sentence, and one bit of a float: no number of a message depends on them.
ALLOWED = {("baseline/suspicions.py", "arccos"), ("baseline/turn.py", "arcsin"), ("contact/comparison.py", "**")}
C_NAMES = """
exp exp2 expm1 log log2 log10 log1p pow cbrt hypot sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh
erf erfc lgamma tgamma fma sincos
"""
OF_THE_C_LIBRARY = {name + suffix for name in C_NAMES.split() for suffix in ("", "f", "l")}


def sources(*suffixes: str) -> list[Path]:
    paths = [*(path for room in ROOMS for path in (PACKAGE / room).rglob("*")), *(PACKAGE / name for name in FILES)]
    paths += SKIN.glob("*")
    return sorted(path for path in paths if path.suffix in suffixes and path.name not in ELSEWHERE)


def used(tree: ast.AST) -> Iterator[str]:
    """The functions that a module takes of NumPy, math and SciPy, and operators that lead to them."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult | ast.Pow):
            constant = isinstance(node, ast.BinOp) and isinstance(node.left, ast.Constant) and node.left.value == 2
            if not (constant and isinstance(node.op, ast.Pow)):
                yield "@" if isinstance(node.op, ast.MatMult) else "**"
        elif isinstance(node, ast.Attribute):
            of_module = isinstance(node.value, ast.Name) and node.value.id in ("np", "math")
            yield from [node.attr] if of_module or node.attr in ("dot", "linalg") else []
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "pow":
            yield "pow"
        elif isinstance(node, ast.ImportFrom) and node.module != "numpy.typing" and of_numbers(node.module or ""):
            yield from (alias.name if node.module == "math" else f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            plain = {("numpy", "np"), ("math", None)}
            yield from (one.name for one in node.names if of_numbers(one.name) and (one.name, one.asname) not in plain)


def of_numbers(module: str) -> bool:
    return module.partition(".")[0] in ("math", "cmath", "numpy", "scipy", "statistics")


def short(path: Path) -> str:
    return str(path.relative_to(PACKAGE if path.is_relative_to(PACKAGE) else SKIN.parent))


@pytest.mark.parametrize("path", sources(".py"), ids=short)
def test_no_number_of_a_message_depends_on_the_processor(path: Path) -> None:
    name = short(path)
    found = set(used(ast.parse(path.read_text()))) - EXACT
    found -= {one for file, one in ALLOWED if file == name}
    assert not found, f"{name} uses {', '.join(sorted(found))}: fmfts.arithmetic has the same for every processor"


@pytest.mark.parametrize("path", sources(".c", ".h"), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_number_of_c_depends_on_the_processor(path: Path) -> None:
    found = set(re.findall(r"\b(\w+)\(", path.read_text())) & OF_THE_C_LIBRARY
    assert not found, f"{path.name} calls {', '.join(sorted(found))}: elementary.h has the same for every processor"


@pytest.mark.parametrize(
    "code",
    """a @ b; a @= b; x ** 3; x **= 2; pow(x, 1.5); a.dot(b)
    np.linalg.norm(a); np.exp(x); np.einsum('i,i', a, b); np.logaddexp(a, b); np.cov(a); math.exp(x)
    from math import erf; import math as m; import numpy as n; import numpy.linalg as la; import scipy; import cmath
    from numpy.linalg import norm; from numpy import exp; from scipy.linalg import cholesky
    import statistics""".replace("\n", ";").split(";"),
)
def test_processor_dependent_rounding_is_found(code: str) -> None:
    assert set(used(ast.parse(code.strip()))) - EXACT


# As OpenBLAS and glibc choose on older and newer processors; `make same-numbers` tries more.
OF_ANOTHER = {
    "Sandybridge": {"OPENBLAS_CORETYPE": "Sandybridge", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
}


@pytest.mark.parametrize("processor", OF_ANOTHER)
def test_recording_replays_identically_on_another_processor(processor: str) -> None:
    script = "import sys; from pathlib import Path; from fmfts_recording.replay import Replay\n"
    script += "for path in sys.argv[1:]:\n replay = Replay(Path(path)); list(replay.contacts())\n"
    script += " print(replay.comparison.is_the_same, replay.facts()['sha256'])"
    said = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, *map(str, RECORDINGS)],
        env=os.environ | OF_ANOTHER[processor],
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.stdout.splitlines() == [f"True {digest}" for digest in digests()], said.stderr


@cache
def digests() -> list[str]:
    found = []
    for path in RECORDINGS:
        replay = Replay(path)
        assert list(replay.contacts())
        found.append(replay.facts()["sha256"])
    return found
