"""Every command of the pages is typed by a test, or carries a reason; its verb and options exist."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest

from fmfts.cli.main import command_line
from pages.commands import PAGES, ROOT, Command, Known, commands_of, every_command

sys.path.insert(0, str(ROOT / "systemd"))

from manual_pages import verbs_of

VERBS = verbs_of(command_line())
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
    """The words for the daemon's command line; None if another program is called. `[--x Y]` may be left out."""
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


def unknown_options(text: str) -> list[str]:
    """Options in backticks that their verb lacks; a verb may have verbs of its own (`keys new`)."""
    found = []
    for span in re.findall(r"(?<!`)`([^`]+)`(?!`)", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)):
        verb = VERBS.get(next(iter(span.removeprefix("fmfts-daemon ").split()), ""))
        if verb is not None:
            parsers = [verb, *verbs_of(verb).values()]
            known = {word for one in parsers for action in one._actions for word in action.option_strings}
            given = re.findall(r"(?<![\w-])--?[a-z][\w-]*", span)
            found += [f"{span}: {word}" for word in given if word not in known]
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_options_named_in_a_sentence_exist(page: Path) -> None:
    assert unknown_options(page.read_text()) == []


def test_unknown_option_in_a_sentence_is_found() -> None:
    text = "Use `baseline --rest`, `keys new --may-change` or\n`fmfts-daemon baseline\n--reset`; `frobnicate --now`."
    assert unknown_options(text) == ["fmfts-daemon baseline\n--reset: --reset"]
