"""Targets, variables and options of the other programs that the pages name: the real Makefile and parsers take them.

tests/unit/test_page_commands.py does the same for `fmfts-daemon`.
"""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import pytest

from pages.commands import ROOT, every_command, parts_of

WORDS = list(dict.fromkeys(part.words for one in every_command() for part in parts_of(one.words)))
VARIABLE = re.compile(r"[A-Z_]+=")
TARGET = re.compile(r"^([\w./-]+):(?!=)", re.MULTILINE)
USED = re.compile(r"\$[({](\w+)|^(?:ifdef|ifndef) (\w+)", re.MULTILINE)
PYTHON = re.compile(r"(?:\S*/)?python3?$")
pytestmark = pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # of runpy
LACKING = {"fmfts_mujoco": "mujoco"}  # packages that this repository's tests do not need


class Parsed(BaseException):
    """Ends a program once it has read its options. No `except Exception` of the program may hold it up."""


@cache
def makefile(folder: str) -> tuple[set[str], set[str]]:
    """All targets, and all variables that anything of it uses."""
    command = ["make", "--no-print-directory", "-C", str(ROOT / folder), "-qp", ":"]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    used = {one or other for one, other in USED.findall(said + (ROOT / folder / "Makefile").read_text())}
    return set(TARGET.findall(said)), used


def of_python(words: str) -> list[str] | None:
    """The words after `python`; None if another program is called. `[--x Y]` may be left out."""
    try:
        found = shlex.split(re.sub(r"\[--[^\]]*\]", "", words).split(" > ")[0])
    except ValueError:
        return None
    while found and VARIABLE.match(found[0]):
        del found[0]
    return found[1:] if found and PYTHON.match(found[0]) else None


def parse(program: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """SystemExit if the program's own parser refuses its options; nothing of the program runs after that."""
    parse_args = argparse.ArgumentParser.parse_args

    def parsed(self: argparse.ArgumentParser, *rest: Any) -> None:
        parse_args(self, *rest)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parsed)
    is_module = program[0] == "-m"
    named, options = program[is_module], program[is_module + 1 :]
    monkeypatch.setattr(sys, "argv", [named, *options])
    monkeypatch.setattr(sys, "path", [str((ROOT / named).parent), *sys.path])
    run: Callable[..., object] = runpy.run_module if is_module else runpy.run_path
    with pytest.raises(Parsed):
        run(named if is_module else str(ROOT / named), run_name="__main__")


def test_make_help_prints_the_list_of_targets() -> None:
    shown = subprocess.run(
        ["make", "--no-print-directory", "help"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert shown[0] == "make help    print these lines"
    listed = [line for line in (ROOT / "Makefile").read_text().splitlines() if line.startswith(("# make ", "#   "))]
    assert len(listed) > 50
    assert [f"# {line}" for line in shown] == listed[: len(shown)]
    assert shown[-1].startswith("make bench ")


@pytest.mark.parametrize("words", [words for words in WORDS if words.startswith("make ") or words == "make"])
def test_make_has_every_target_and_variable_of_the_pages(words: str) -> None:
    told = shlex.split(words)[1:]
    folder = told[told.index("-C") + 1] if "-C" in told else "."
    targets, variables = makefile(folder)
    for word in told:
        if VARIABLE.match(word):
            assert word.partition("=")[0] in variables
        elif word not in ("-C", folder):
            assert word in targets


@pytest.mark.parametrize(
    "words", [words for words in WORDS if words.startswith("make ") and re.search(r'[A-Z_]="--', words)]
)
def test_program_takes_options_that_pages_pass_through_make(words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said = subprocess.run(
        ["make", "-n", *shlex.split(words)[1:]], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    options = shlex.split(words.partition("=")[2])[0]
    (line,) = [line for line in said.splitlines() if line.endswith(options)]
    program = of_python(line)
    assert program is not None
    parse(program, monkeypatch)


@pytest.mark.parametrize("words", [words for words in WORDS if of_python(words) is not None])
def test_program_takes_every_option_of_the_pages(words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program = of_python(words)
    assert program is not None
    if program[:2] == ["-m", "pytest"]:
        files = [ROOT / word for word in program[2:] if word.endswith(".py")]
        assert files
        assert [file for file in files if not file.exists()] == []
        if "-k" in program:
            named = re.findall(r"\w+", program[program.index("-k") + 1])
            text = "".join(file.read_text() for file in files)
            assert [name for name in named if name not in ("and", "or", "not") and name not in text] == []
        return
    if program[:2] == ["-m", "venv"]:
        return
    is_module = program[0] == "-m"
    package = program[1].partition(".")[0] if is_module else next(iter(LACKING), "")
    needed = LACKING.get(package) if is_module or "clients/mujoco" in program[0] else None
    if needed is not None and find_spec(needed) is None:
        pytest.skip(f"{needed} is not installed (make mujoco)")
    if is_module or "parse_args" in (ROOT / program[0]).read_text():
        parse(program, monkeypatch)


def test_wrong_option_of_a_page_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(["-m", "fmfts_lab.bench", "slip", "--no-such-option"], monkeypatch)
    assert "--no-such-option" in capsys.readouterr().err
    assert not {"no-such-target"} & makefile(".")[0]
    assert not {"NO_SUCH_VARIABLE"} & makefile(".")[1]
