"""A name ends where its pattern ends: `$` also accepts a newline behind the name, which splits a line of a list."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from fmfts.bus.keys import KeyFolder, OptionError
from fmfts.config.file import ConfigError, load

ROOT = Path(__file__).parents[2]
READERS = {"compile", "match", "search", "fullmatch"}
PAD = '[[pad]]\nname = "{name}"\n[pad.source]\ntype = "{source}"\n'


def patterns(path: Path) -> Iterator[str]:
    """The constant parts of the regular expressions in a file, without those whose `$` is the end of each line."""
    source = path.read_text()
    if "re." not in source and "pattern" not in source:
        return  # faster than reading its syntax
    for call in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)):
        is_re = isinstance(call.func, ast.Attribute) and call.func.attr in READERS and call.args
        given = [call.args[0]] if is_re else []
        given += [word.value for word in call.keywords if word.arg == "pattern"]
        for pattern in given:
            parts = [each.value for each in ast.walk(pattern) if isinstance(each, ast.Constant)]
            text = "".join(part for part in parts if isinstance(part, str))
            if "MULTILINE" not in ast.unparse(call) and "(?m)" not in text:
                yield text


@pytest.mark.parametrize("folder", ["daemon", "clients", "lab", "extras", "systemd"])
def test_no_pattern_ends_with_a_dollar(folder: str) -> None:
    """`\\Z` or fullmatch; `$` alone stands for the end of each line."""
    wrong = [
        f"{path.relative_to(ROOT)}: {text}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for text in patterns(path)
        if re.search(r"(?<!\\)\$", re.sub(r"\[[^]]*\]", "", text))
    ]
    assert wrong == []


@pytest.mark.parametrize("name", ["leg\n", "leg\r", "\nleg", "leg\n\n", "leg arm", "", "l" * 65, "bein\N{KELVIN SIGN}"])
def test_name_of_a_client_that_cannot_be_changes_nothing(tmp_path: Path, name: str) -> None:
    keys = KeyFolder(tmp_path / "keys")
    keys.add("arm", tmp_path / "arm.key")
    with pytest.raises(OptionError, match="is not a client's name"):
        keys.add(name, tmp_path / "other.key")
    assert list(keys.clients()) == ["arm"]
    assert not (tmp_path / "other.key").exists()


@pytest.mark.parametrize("name", ["left\\n", "left\\r", "\\nleft", "", "l" * 33])
def test_name_of_a_pad_that_cannot_be_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "config.toml").write_text(PAD.format(name=name, source="simulated"))
    with pytest.raises(ConfigError, match="must be 1 to 32 letters"):
        load(tmp_path / "config.toml")


def test_newline_behind_a_board_id_is_refused(tmp_path: Path) -> None:
    uid = f'uid = "{"0" * 24}\\n"\n'
    (tmp_path / "config.toml").write_text(PAD.format(name="left", source="bridge") + 'port = "/dev/ttyACM0"\n' + uid)
    with pytest.raises(ConfigError, match="24 hexadecimal digits"):
        load(tmp_path / "config.toml")
