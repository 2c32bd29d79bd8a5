"""Every command of the pages is typed by a test, or carries a reason; its verb and options exist."""

from __future__ import annotations

import re
import shlex

import pytest

from fmfts.cli.main import command_line
from pages.commands import ROOT, Command, Known, commands_of, every_command

KNOWN = Known.read()
COMMANDS = every_command()
PAGE = """Text `make x`.

    fmfts-daemon probe --config pad.toml   # what is there
    # a comment
    FMFTS_BUS=tcp://x fmfts-daemon run

    make test

A file:

    [pad]
    name = "left"

```python
fmfts-daemon no
```

```
$ fmfts-daemon status   # now
health: ok
…
$ fmfts-daemon pads
```
"""


def daemon_words(command: Command) -> list[str] | None:
    """What the daemon's command line gets; None if another program is called. `[--x Y]` may be left out."""
    words = re.sub(r"\[--[^\]]*\]", "", command.words).split(" > ")[0]
    called = re.match(r"(?:[A-Z_]+=\S+ )*fmfts-daemon (.*)", words)
    return shlex.split(called[1]) if called else None


def test_commands_are_found_without_comments_and_with_what_is_shown() -> None:
    assert [command[1:] for command in commands_of("x.md", PAGE)] == [
        ("fmfts-daemon probe --config pad.toml", ()),
        ("FMFTS_BUS=tcp://x fmfts-daemon run", ()),
        ("make test", ()),
        ("fmfts-daemon status", ("health: ok",)),
        ("fmfts-daemon pads", ()),
    ]


def test_unknown_program_in_a_console_is_refused() -> None:
    with pytest.raises(ValueError, match=r"x\.md: 'frobnicate --now'"):
        commands_of("x.md", "    make test\n    frobnicate --now\n")


def test_command_may_continue_in_the_next_line() -> None:
    assert [command.words for command in commands_of("x.md", "    make test \\\n        lint\n")] == ["make test lint"]


def test_pages_have_commands_typed_and_such_not() -> None:
    typed = [command for command in COMMANDS if KNOWN.reason(command) is None]
    assert len(COMMANDS) > 100
    assert len(typed) > 20
    assert {"README.md", "docs/recording.md"} <= {command.page for command in typed}


def test_every_reason_has_command_and_every_test_named_exists() -> None:
    told = [f"{command.page}: {command.words}" for command in COMMANDS]
    patterns = [pattern for pattern, _ in [*KNOWN.not_run, *KNOWN.elsewhere, *KNOWN.instead]]
    assert [one for one in patterns if not any(re.search(one, line) for line in told)] == []
    files = {word for _, why in [*KNOWN.not_run, *KNOWN.elsewhere] for word in re.findall(r"tests/\S+\.py", why)}
    assert [file for file in sorted(files) if not (ROOT / file).exists()] == []


@pytest.mark.parametrize("command", dict.fromkeys(COMMANDS), ids=lambda command: f"{command.page}: {command.words}")
def test_daemon_takes_every_verb_and_option_of_the_pages(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    """SystemExit ends a command line that the daemon refuses."""
    words = daemon_words(command)
    if words is not None:
        command_line().parse_args(words)
    assert capsys.readouterr().err == ""
