"""Manual pages, and completion for bash and zsh, made of the parser itself: `python systemd/manual_pages.py FOLDER`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from fmfts import __version__
from fmfts.cli.main import EPILOG, command_line

PROGRAM = "fmfts-daemon"
Parsers = dict[str, argparse.ArgumentParser]


def verbs_of(parser: argparse.ArgumentParser) -> Parsers:
    """The parser of each verb, by its name."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def options_of(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in parser._actions if action.option_strings]


def man_pages() -> dict[str, str]:
    """Text of each page, by its file's name."""
    parser = command_line()
    verbs = verbs_of(parser)
    pages = {f"{PROGRAM}.1": _page(PROGRAM, parser, _list_of(verbs))}
    for name, verb in verbs.items():
        inner = verbs_of(verb)
        pages[f"{PROGRAM}-{name}.1"] = _page(f"{PROGRAM}-{name}", verb, _list_of(inner))
    return pages


def bash_completion() -> str:
    """Completes verbs after the program, options after a verb, and files elsewhere."""
    verbs = verbs_of(command_line())
    cases = "\n".join(f'        {name}) words="{" ".join(_words(verb))}" ;;' for name, verb in verbs.items())
    return f"""# bash completion of {PROGRAM}, made by systemd/manual_pages.py
_fmfts_daemon() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{" ".join(verbs)} --help --version"
    else
        case "${{COMP_WORDS[1]}}" in
{cases}
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _fmfts_daemon {PROGRAM}
"""


def zsh_completion() -> str:
    """Like `bash_completion`, with the help of each verb and option."""
    verbs = verbs_of(command_line())
    described = "\n".join(f"        {_zsh(name, _first_line(verb))}" for name, verb in verbs.items())
    cases = "\n".join(
        f"        {name}) choices=({' '.join(_zsh(word, text) for word, text in _described(verb))}) ;;"
        for name, verb in verbs.items()
    )
    return f"""#compdef {PROGRAM}
# made by systemd/manual_pages.py
local -a choices
if (( CURRENT == 2 )); then
    choices=(
{described}
    )
else
    case "$words[2]" in
{cases}
    esac
fi
_describe '{PROGRAM}' choices
_files
"""


def _words(verb: argparse.ArgumentParser) -> list[str]:
    return [word for word, _ in _described(verb)]


def _described(verb: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Each option, and each verb of a verb, with its help."""
    for action in options_of(verb):
        for word in action.option_strings:
            yield word, _help(verb, action)
    for name, inner in verbs_of(verb).items():
        yield name, _first_line(inner)


def _zsh(word: str, text: str) -> str:
    plain = text.replace("'", "’").replace(":", "\\:")
    return f"'{word}:{plain}'"


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return (parser._get_formatter()._expand_help(action) if action.help else "").replace("\n", " ")


def _first_line(parser: argparse.ArgumentParser) -> str:
    return (parser.description or "").split("\n")[0]


def _page(name: str, parser: argparse.ArgumentParser, verbs: list[tuple[str, str]]) -> str:
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    lines = [
        f'.TH {name.upper().replace("-", chr(92) + "-")} 1 "" "fmfts {__version__}" "fmfts"',
        ".SH NAME",
        f"{_roff(name)} \\- {_roff(_first_line(parser))}",
        ".SH SYNOPSIS",
        _roff(usage),
    ]
    if verbs:
        lines += [".SH VERBS", *(line for verb, text in verbs for line in (".TP", f".B {_roff(verb)}", _roff(text)))]
    positionals = [action for action in parser._actions if not action.option_strings and not _is_verbs(action)]
    if positionals:
        lines.append(".SH ARGUMENTS")
        for action in positionals:
            lines += [".TP", f".I {_roff(str(action.metavar or action.dest))}", _roff(_help(parser, action))]
    lines.append(".SH OPTIONS")
    for action in options_of(parser):
        shown = ", ".join(action.option_strings)
        shown += f" {action.metavar or action.dest.upper()}" if action.nargs != 0 else ""
        lines += [".TP", f".B {_roff(shown)}", _roff(_help(parser, action))]
    if parser.prog == PROGRAM:
        lines += [".SH NOTES", ".nf", *(_roff(line) or "." for line in EPILOG.splitlines()), ".fi"]
    lines += [".SH SEE ALSO", f"{_roff(PROGRAM)}(1); the manual in /usr/share/doc/fmfts/docs/README.md"]
    return "\n".join(lines) + "\n"


def _list_of(verbs: Parsers) -> list[tuple[str, str]]:
    return [(name, _first_line(verb)) for name, verb in verbs.items()]


def _is_verbs(action: argparse.Action) -> bool:
    return isinstance(action, argparse._SubParsersAction)


def _roff(text: str) -> str:
    """Text without troff requests."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{escaped}" if escaped.startswith((".", "'")) else escaped


def main(folder: Path) -> None:
    """Write all of it where Debian looks for it, below `folder` (/usr in a package)."""
    files = {f"share/man/man1/{name}": text for name, text in man_pages().items()}
    files[f"share/bash-completion/completions/{PROGRAM}"] = bash_completion()
    files[f"share/zsh/vendor-completions/_{PROGRAM}"] = zsh_completion()
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python systemd/manual_pages.py FOLDER, such as ~/.local")
    main(Path(sys.argv[1]))
