"""Every command of the pages: which ones `make docs-test` types, and why it does not type the others.

`python tests/pages/commands.py` lists them with the reason, and counts them. Tests parse all of them.

commands.toml says what the pages cannot: which commands another test types, which none can, and why.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import NamedTuple

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += [ROOT / "lab/README.md", *sorted((ROOT / "lab/results").glob("*.md"))]
PAGES += [page for folder in ("clients", "extras", "firmware") for page in sorted((ROOT / folder).glob("**/*.md"))]
TABLE = Path(__file__).with_name("commands.toml")
BLOCK = re.compile(
    r"^```(?:|sh|bash|console)\n(.*?)^```$|((?:^    [^\n]*\n(?:\n(?=    ))?)+)", re.MULTILINE | re.DOTALL
)
OTHER_BLOCK = re.compile(r"^```\w+\n.*?^```$", re.MULTILINE | re.DOTALL)
# The beginning of a console line; a block whose first line begins otherwise is a file or a program's output.
PROGRAM = re.compile(
    r"(?:[A-Z_]+=\S+ )*(?:fmfts-daemon|make|(?:\S*/)?python3?|pip|sudo|sudoedit|apt-get|apt|git|gpg|ssh-keygen"
    r"|sha256sum|scp|ssh|ln|cd|ros2|mkdir|chmod|cp|zip|journalctl|dask|cmake|curl|firmware/build/\S+|\$EDITOR|\.)"
    r"(?= |$)"
)


class Command(NamedTuple):
    """words: without the comment. shown: the lines of output that the page shows."""

    page: str
    words: str
    shown: tuple[str, ...] = ()


class Part(NamedTuple):
    """One program of a command line, without `sudo`."""

    words: str
    variables: tuple[str, ...] = ()  # variables that are set in front of it


# Programs whose options test_page_commands.py and test_page_programs.py check.
PARSED_ELSEWHERE = re.compile(r"(?:fmfts-daemon|make|(?:\S*/)?python3?)(?= |$)")


def parts_of(words: str) -> list[Part]:
    """The programs of `A && B; C`."""
    found = []
    for part in re.split(r"&&|;", words):
        variables = re.match(r"(?:[A-Z_]+=\S+ )*", part.strip())
        assert variables is not None
        rest = part.strip()[variables.end() :].removeprefix("sudo ")
        found.append(Part(rest, tuple(re.findall(r"([A-Z_]+)=", variables[0]))))
    return found


class Known(NamedTuple):
    """commands.toml. Patterns are regular expressions, looked for in `PAGE: COMMAND`."""

    not_run: list[tuple[str, str]]  # pattern, reason
    elsewhere: list[tuple[str, str]]  # pattern, the test that types it
    instead: list[tuple[str, str]]  # pattern, the command that is typed instead

    @classmethod
    def read(cls) -> Known:
        table = tomllib.loads(TABLE.read_text())
        return cls(*([(one["command"], one[key]) for one in table[name]] for name, key in
                     (("not_run", "reason"), ("elsewhere", "test"), ("instead", "typed"))))  # fmt: skip

    def reason(self, command: Command) -> str | None:
        """Why it is not typed by `make docs-test`; None if it is."""
        for pattern, why in [*self.not_run, *self.elsewhere]:
            if re.search(pattern, f"{command.page}: {command.words}"):
                return why
        return None

    def typed(self, command: Command) -> str:
        words = command.words
        for pattern, typed in self.instead:
            words = re.sub(pattern, typed, f"{command.page}: {words}").removeprefix(f"{command.page}: ")
        return words


def blocks(text: str) -> list[str]:
    found = BLOCK.findall(OTHER_BLOCK.sub("", text))
    return [fenced or re.sub(r"^    ", "", indented, flags=re.MULTILINE) for fenced, indented in found]


def without_comment(line: str) -> str:
    return re.split(r"(?:^|\s+)# ", line)[0].strip()


def commands_of(page: str, text: str) -> list[Command]:
    """ValueError names a line of a console that begins with no known program."""
    found: list[Command] = []
    for block in blocks(re.sub(r"\\\n *", "", text)):  # a command may go on in the next line
        lines = [line for line in block.splitlines() if without_comment(line)]
        if lines and lines[0].startswith("$ "):
            for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
                words, *shown = part.splitlines()
                found.append(Command(page, without_comment(words), tuple(one for one in shown if one != "…")))
        elif lines and PROGRAM.match(lines[0]):
            for line in lines:
                if not PROGRAM.match(line):
                    raise ValueError(f"{page}: {line!r} begins with no program that tests/pages/commands.py knows")
                found.append(Command(page, without_comment(line)))
    return found


def every_command() -> list[Command]:
    return [one for page in PAGES for one in commands_of(str(page.relative_to(ROOT)), page.read_text())]


def main() -> None:
    known = Known.read()
    elsewhere = {test for _, test in known.elsewhere}
    count = {"typed by make docs-test": 0, "typed by another test": 0, "parsed alone": 0}
    for one in every_command():
        reason = known.reason(one)
        print(f"{one.page}: {one.words}\n    {reason or 'typed'}")
        count[list(count)[0 if reason is None else 1 if reason in elsewhere else 2]] += 1
    print(f"{sum(count.values())} commands:", ", ".join(f"{number} {how}" for how, number in count.items()))


if __name__ == "__main__":
    main()
