"""Defines the verb `collect`: its options and what it prints."""

from __future__ import annotations

import argparse
import logging
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmfts.cli.verb import AddVerb, VerbError, configuration_as, ended_by, pad_named, require_known_magnets
from fmfts.common import exit_codes

if TYPE_CHECKING:
    from fmfts.config import PadConfig
    from fmfts_collect.settings import CollectingConfig


log = logging.getLogger("fmfts")


def add_to(verb: AddVerb) -> None:
    """Add the verb. verb: makes a parser from a name, a handler and a line of help."""
    collect = verb("collect", _collect, "press a plan of places and forces, and write the calibration data")
    collect.add_argument(
        "plan", metavar="GRID.toml", nargs="?", help="a plan's file, or a preset: see docs/collecting.md"
    )
    collect.add_argument("-o", "--output", type=Path, metavar="DATA.csv", help="the table; continued if it exists")
    collect.add_argument(
        "--by-hand", action="store_true", help="you press; [collect.gauge] measures the force, or you type it"
    )
    collect.add_argument(
        "--merge", type=Path, metavar="LOG.csv", help="instead of a plan: another machine's log of the presses"
    )
    collect.add_argument(
        "--against",
        metavar="PAD",
        help="instead of a plan: a weighed pad of the recording that presses against this one: it labels the forces",
    )
    collect.add_argument(
        "--frames", type=Path, metavar="RECORDING", help="for --merge and --against: what `record` wrote meanwhile"
    )
    collect.add_argument(
        "--weigh-g", type=float, nargs=2, metavar="GRAM", help="instead: find the load cell's scale by two weights"
    )
    collect.add_argument("--pad", metavar="NAME", help="needed if there are several")
    collect.add_argument("--json", action="store_true", help="print facts as JSON")


def _collect(options: argparse.Namespace) -> int:
    from fmfts.cli.feed import FeedError
    from fmfts.view.facts import print_facts
    from fmfts_collect.errors import CollectError
    from fmfts_collect.settings import CollectingConfig

    config, path = configuration_as(CollectingConfig, options)
    log.info("configuration: %s", path)
    pad = pad_named(config, options.pad)
    require_known_magnets(pad)
    # Signals that end the program lift the rod first. Ctrl-Z would stop the program with the rod down: ignore it.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    with ended_by(CollectError, FeedError):
        facts = _carry_out(options, config, pad)
    print_facts(facts, as_json=options.json)
    return 0


def _ask(text: str) -> None:
    input(f"{text} ")


def _carry_out(options: argparse.Namespace, config: CollectingConfig, pad: PadConfig) -> dict[str, Any]:
    if options.weigh_g is not None:
        from fmfts.cli.feed import open_feed
        from fmfts_collect.weigh import weigh

        feed = open_feed(config, pad)
        try:
            return weigh(feed, options.weigh_g, _ask)
        finally:
            feed.close()
    if options.output is None:
        raise VerbError(exit_codes.USAGE, "where to? -o DATA.csv")
    if options.merge is not None:
        from fmfts_collect.merging import merge

        if options.frames is None:
            raise VerbError(exit_codes.USAGE, "--merge needs --frames RECORDING, which fmfts-daemon record wrote")
        return merge(config, pad, options.merge, options.frames, options.output)
    if options.against is not None:
        from fmfts_collect.merging import against

        if options.frames is None:
            raise VerbError(exit_codes.USAGE, "--against needs --frames RECORDING, which fmfts-daemon record wrote")
        if options.against == pad.name:
            raise VerbError(exit_codes.USAGE, f"--against {options.against}: name the other pad; --pad is this one")
        return against(config, pad, options.against, options.frames, options.output)
    if options.plan is None:
        raise VerbError(exit_codes.USAGE, "which plan? GRID.toml, or a preset")
    from fmfts_collect.work import collect

    return collect(config, pad, options.plan, options.output, options.by_hand)
