"""The commands that messages of the daemon tell to type: `fmfts-daemon …` accepts each."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from fmfts.cli.main import command_line

ROOT = Path(__file__).parents[2]
COMMAND = re.compile(r"`fmfts-daemon ([^`]*)`")
NAMED_VALUES = re.compile(r"the following arguments are required: [A-Z-]")  # a file or weight that only its user knows


def commands() -> list[tuple[str, str]]:
    """(place, words) of each command in a text of the code, without those of docstrings."""
    found = []
    for path in sorted(path for folder in ("daemon", "extras") for path in (ROOT / folder).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        plain = [node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)]  # docstrings
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in plain:
                place = f"{path.relative_to(ROOT)}:{node.lineno}"
                found += [(place, words) for words in COMMAND.findall(node.value)]
    return found


def test_command_of_each_message_is_accepted(capsys: pytest.CaptureFixture[str]) -> None:
    parser, refused = command_line(), []
    named = commands()
    assert len(named) > 40
    for place, words in named:
        try:
            parser.parse_args(words.split())
        except SystemExit:
            why = capsys.readouterr().err
            if not NAMED_VALUES.search(why):
                refused.append(f"{place}: {words}: {why.splitlines()[-1]}")
    assert not refused
