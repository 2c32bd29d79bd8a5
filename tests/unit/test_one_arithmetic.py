"""What is computed between a frame and a message is computed by fmfts.arithmetic alone: the same on every processor."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import fmfts
from fmfts.offline.replay import Replay

PACKAGE = Path(fmfts.__file__).parent
RECORDINGS = sorted((Path(__file__).parents[1] / "data" / "recordings").glob("*.mcap"))
# All that a message depends on, from the configuration and a baseline's file on; what only advises in the log is not.
ROOMS = ["baseline", "common", "config", "contact", "pipeline", "pose", "runtime", "scene", "sensor"]
FILES = ["pad.py"]
ELSEWHERE = {"advice.py", "candidate.py", "error_budget.py"}
# BLAS, LAPACK, wide vectors, the C library: each rounds as the processor lets it. So does ** but for small constants.
OF_THE_C_LIBRARY = {
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "cbrt", "hypot"),
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("erf", "erfc", "lgamma", "tgamma", "fma", "sincos"),
}
BANNED = OF_THE_C_LIBRARY | {
    *("linalg", "dot", "vdot", "inner", "matmul", "einsum", "tensordot", "interp", "polyfit", "convolve", "fft"),
    *("power", "float_power", "arcsin", "arccos", "arctan", "arctan2", "gamma"),
}
# Degrees in a sentence, and one bit of a float: no message's number comes of them.
ALLOWED = {("baseline/diagnosis.py", "arccos"), ("baseline/turn.py", "arcsin"), ("contact/comparison.py", "**")}


def sources(*suffixes: str) -> list[Path]:
    paths = [*(path for room in ROOMS for path in (PACKAGE / room).rglob("*")), *(PACKAGE / name for name in FILES)]
    return sorted(path for path in paths if path.suffix in suffixes and path.name not in ELSEWHERE)


def used(tree: ast.AST) -> Iterator[str]:
    """The names of BANNED that a module takes from NumPy or math, and operators that go the same way."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult | ast.Pow):
            constant = isinstance(node, ast.BinOp) and isinstance(node.left, ast.Constant) and node.left.value == 2
            if not (constant and isinstance(node.op, ast.Pow)):
                yield "@" if isinstance(node.op, ast.MatMult) else "**"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("np", "math"):
            yield node.attr
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ("math", "numpy", "scipy"):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize("path", sources(".py"), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_number_of_a_message_depends_on_the_processor(path: Path) -> None:
    name = str(path.relative_to(PACKAGE))
    found = {one for one in used(ast.parse(path.read_text())) if one in BANNED | {"@", "**"}}
    found -= {one for file, one in ALLOWED if file == name}
    assert not found, f"{name} uses {', '.join(sorted(found))}: fmfts.arithmetic has the same for every processor"


@pytest.mark.parametrize("path", sources(".c", ".h"), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_number_of_c_depends_on_the_processor(path: Path) -> None:
    found = set(re.findall(r"\b(\w+)\(", path.read_text())) & OF_THE_C_LIBRARY
    assert not found, f"{path.name} calls {', '.join(sorted(found))}: elementary.h has the same for every processor"


def test_every_banned_name_would_be_found() -> None:
    code = "import numpy as np\nfrom math import erf\nnp.linalg.norm(a) + (a @ b) ** 3 + np.exp(erf(x))\na @= b\n"
    assert set(used(ast.parse(code))) & (BANNED | {"@", "**"}) == {"linalg", "erf", "@", "**", "exp"}


# As OpenBLAS, NumPy and glibc choose on older and newer processors; what this one lacks they leave alone.
OF_ANOTHER = {
    "Prescott": {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"},
    "Sandybridge": {"OPENBLAS_CORETYPE": "Sandybridge", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
}


@pytest.mark.parametrize("processor", OF_ANOTHER)
def test_a_recording_replays_identically_on_another_processor(processor: str) -> None:
    script = "import sys; from pathlib import Path; from fmfts.offline.replay import Replay\n"
    script += "for path in sys.argv[1:]:\n replay = Replay(Path(path)); list(replay.contacts())\n"
    script += " print(replay.comparison.is_the_same, replay.facts()['sha256'])"
    said = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, *map(str, RECORDINGS)],
        env=os.environ | OF_ANOTHER[processor],
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.splitlines() == [f"True {digest}" for digest in digests()], said.stderr


def digests() -> list[str]:
    found = []
    for path in RECORDINGS:
        replay = Replay(path)
        assert list(replay.contacts())
        found.append(replay.facts()["sha256"])
    return found
