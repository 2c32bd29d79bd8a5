"""Defines the verbs `layout` and `manual`: files for other programs, a shell and `man`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fmfts.cli import elsewhere
from fmfts.cli.verb import AddVerb, VerbError, not_written
from fmfts.common import exit_codes

PROGRAMS = ("foxglove", "plotjuggler")
OWN_LAYOUTS = {"plotjuggler": Path(__file__).parents[1] / "view" / "layouts" / "plotjuggler.xml"}
DRAWN_PAD = "left"  # the pad for which the files are written


def add_to(verb: AddVerb) -> None:
    """Add both verbs. verb: makes a parser from a name, a handler and a line of help."""
    layout = verb("layout", _layout, "print a layout of Foxglove or PlotJuggler for a pad")
    layout.add_argument("program", choices=PROGRAMS)
    layout.add_argument("--pad", metavar="NAME", help="the pad's name (default: that of the configuration, else demo)")
    manual = verb("manual", _manual, "install manual pages, and completion for bash and zsh")
    manual.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=Path("~/.local"),
        metavar="FOLDER",
        help="below it, in share/ (default: ~/.local)",
    )


def layout_for(program: str, pad: str) -> str:
    """The layout of `program`, one of PROGRAMS, for this pad. Raises VerbError where its package is not installed."""
    path = OWN_LAYOUTS[program] if program in OWN_LAYOUTS else elsewhere.layout(program)
    drawn = path.read_text(encoding="utf-8")
    return drawn.replace(f"/{DRAWN_PAD}", f"/{pad}").replace(f'tab_name="{DRAWN_PAD}"', f'tab_name="{pad}"')


def _layout(options: argparse.Namespace) -> int:
    sys.stdout.write(layout_for(options.program, options.pad or _usual_pad(options)))
    return 0


def _usual_pad(options: argparse.Namespace) -> str:
    from fmfts.cli.verb import configuration_if_any

    config = configuration_if_any(options)
    if config is None:
        return "demo"
    names = [pad.name for pad in config.pad]
    if len(names) > 1:
        raise VerbError(exit_codes.USAGE, f"several pads are configured: give --pad with one of {', '.join(names)}")
    return names[0]


def _manual(options: argparse.Namespace) -> int:
    from fmfts.cli import manual

    folder = options.folder.expanduser()
    try:
        manual.main(folder)
    except OSError as error:
        raise not_written(error, folder) from error
    print(
        f"written below {folder}/share: try `man fmfts-daemon`\n"
        "bash: a new shell completes fmfts-daemon, if the package bash-completion is installed\n"
        f"zsh: put `fpath+=({folder}/share/zsh/vendor-completions)` before compinit in ~/.zshrc"
    )
    return 0
