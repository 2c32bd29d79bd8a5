"""The verb `study`: its options, and what it prints."""

from __future__ import annotations

import argparse
import json
from importlib import import_module
from pathlib import Path

from fmfts.cli.verb import AddVerb, VerbError, configuration, configured_pad, lacking, not_written
from fmfts.common import exit_codes

# Each is a module with `run(request: Request) -> Facts`, and `printed(facts: Facts) -> str`.
STUDIES: dict[str, str] = {
    "speed-accuracy": "fmfts_lab.study.speed_accuracy",
    "stability": "fmfts_lab.study.stability",
    "scene": "fmfts_lab.study.scene_study",
    "paper-table3": "fmfts_lab.study.paper_table3",
    "paper-table4": "fmfts_lab.study.experiment",
    "transfer": "fmfts_lab.study.transfer",
}
# Option → the study that uses it.
OPTIONS = {"chips": "scene", "controller": "speed-accuracy"}


def add_to(verb: AddVerb) -> None:
    """Add the verb; `verb` makes a parser from a name, a handler and a line of help."""
    study = verb("study", _study, "compare methods on this pad: CSV, JSON, PNG and SVG")
    study.add_argument("study", choices=tuple(STUDIES), metavar="STUDY", help=" | ".join(STUDIES))
    study.add_argument("--out", type=Path, default=Path("studies"), metavar="DIR", help="for its files (studies)")
    study.add_argument("--quick", action="store_true", help="take under a minute, with rougher results")
    study.add_argument("--seed", type=int, default=1, help="seed of all random numbers (1)")
    study.add_argument(
        "--pad", metavar="NAME", help="the pad with this geometry and magnet; needed if there are several"
    )
    study.add_argument("--chips", action="store_true", help="scene: what each kind of chip is worth at this pad, alone")
    study.add_argument("--controller", action="store_true", help="speed-accuracy: what a controller acts on, alone")
    study.add_argument("--json", action="store_true", help="print facts as JSON")


def _study(options: argparse.Namespace) -> int:
    from fmfts_calibrate.field_table import DataError

    pad = configured_pad(options)
    if options.seed < 0:
        raise VerbError(exit_codes.USAGE, f"--seed is {options.seed}: zero or more")
    for option, its in OPTIONS.items():
        if getattr(options, option) and options.study != its:
            told = f"--{option} is an option of `study {its}`, not of `study {options.study}`"
            raise VerbError(exit_codes.USAGE, told)
    try:
        study = import_module(STUDIES[options.study])
    except ImportError as error:
        raise lacking(error, "study") from error
    from fmfts_lab.study.harness import Request, say

    of_all = options.out, options.quick, options.seed, configuration(options).pad
    try:
        facts = study.run(Request(pad, *of_all, options.chips, options.controller))
    except KeyboardInterrupt:
        say(f"stopped; what is done is in {options.out}, and the same command goes on from there")
        raise
    except DataError as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    except OSError as error:
        raise not_written(error, error.filename or options.out) from error
    print(json.dumps(facts, indent=1) if options.json else study.printed(facts))
    return 0
