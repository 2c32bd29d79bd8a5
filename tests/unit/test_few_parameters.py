"""No function on a frame's way has more than six parameters: related ones form a struct, or a class.

A keyword-only option in Python with a default does not count: callers need not know it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import fmfts

MOST = 6
PACKAGE = Path(fmfts.__file__).parent
ROOMS = ("arithmetic", "contact", "pipeline", "pose", "scene", "sensor", "several")
COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
# A function that returns a value and has a name, whose parameters are followed by a block or a semicolon, at the start
# of a line.
FUNCTION = re.compile(r"^[A-Za-z_][\w \t*]*?[ \t*](\w+)\(([^;{}]*?)\)\s*[;{]", re.MULTILINE)


def in_c(code: str) -> Iterator[tuple[str, int]]:
    for name, parameters in FUNCTION.findall(COMMENT.sub("", code)):
        flat = re.sub(r"\([^()]*\)", "", parameters)  # a function that is a parameter has parameters of its own
        yield name, 1 + flat.count(",")


def in_python(code: str) -> Iterator[tuple[str, int]]:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            named = [one for one, default in zip(given.kwonlyargs, given.kw_defaults, strict=True) if default is None]
            names = [one.arg for one in (*given.posonlyargs, *given.args, *named)]
            yield node.name, len(names) - (names[:1] in (["self"], ["cls"]))


def files() -> list[Path]:
    return sorted(path for room in ROOMS for path in (PACKAGE / room).rglob("*") if path.suffix in (".c", ".h", ".py"))


@pytest.mark.parametrize("path", files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_functions_have_at_most_six_parameters(path: Path) -> None:
    found = (in_python if path.suffix == ".py" else in_c)(path.read_text())
    many = [f"{name} ({count})" for name, count in found if count > MOST]
    assert not many, f"{path.name}: {', '.join(many)}: more than {MOST} parameters"


def test_room_check_reads_all_rooms() -> None:
    assert {path.relative_to(PACKAGE).parts[0] for path in files()} == set(ROOMS)
    functions = [name for path in files() if path.suffix == ".c" for name, _ in in_c(path.read_text())]
    assert len(functions) > 500


@pytest.mark.parametrize(
    ("code", "count"),
    [
        ("static bool many(int a, int b, int c,\n int d, int e, int f, /* , */ int g)\n{\n", 7),
        ("FMFTS_INLINE double *several(double (*take)(int, int), double at[2], void *c);", 3),
        ("fmfts_refusal none(void)\n{", 1),
    ],
)
def test_parameters_of_c_are_counted(code: str, count: int) -> None:
    assert [number for _, number in in_c(code)] == [count]


@pytest.mark.parametrize(
    ("code", "count"),
    [
        ("def many(a, b, c, d, e, f, g): ...", 7),
        ("class A:\n def of(self, a, /, b, *, c, d=1): ...", 3),
        ("async def few(a, *more, **others): ...", 1),
    ],
)
def test_parameters_of_python_are_counted(code: str, count: int) -> None:
    assert [number for _, number in in_python(code)] == [count]
