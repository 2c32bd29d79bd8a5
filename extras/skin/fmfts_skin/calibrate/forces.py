"""`calibrate` and `evaluate` for sets with forces in three directions, of any pad, with or without a configuration."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli.verb import VerbError, ended_by, lacking, refuse_options, say, written_to
from fmfts.common import exit_codes
from fmfts.common.reading import unreadable_told
from fmfts_calibrate.kinds import OF_PRESSES, begins_with, columns_of

if TYPE_CHECKING:
    from fmfts_skin.calibrate.force_command import KnownMagnet

MARK = b"fmfts force model"
ROUTES = {"field": "field route", "pose": "pose route", "both": "both routes, weighed by their variances"}


def is_of_forces(data: Path) -> bool:
    """Whether a set has forces in three directions as labels."""
    return "force_z_n" in columns_of(data)


def is_force_model(model: Path) -> bool:
    return begins_with(model, MARK)


def calibrate(options: argparse.Namespace, noise_t: float) -> int:
    try:
        from fmfts_skin.calibrate.force_command import make_force_file
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts_calibrate.evaluation import printed
    from fmfts_calibrate.field_table import DataError

    why = f"{options.data} has force_x_n, force_y_n and force_z_n: leave it out"
    refuse_options(options, ("shear", "sheared", "hidden", "start", "correct", *OF_PRESSES), why)
    with ended_by(DataError), written_to(options.output):
        sources = [options.data, *options.sessions]
        magnet = _magnet(options, noise_t, options.route in ("pose", "both"))
        report = make_force_file(sources, options.output, magnet, options.route, say)
    if options.json:
        print(json.dumps(report, indent=1))
        return 0
    for route in report["routes"]:
        print(f"{ROUTES[route['route']]}, errors on left-out {route['left_out']}:")
        print(printed(route["rows"]))
    print(
        f"{options.output}: force model {report['model']}, by {ROUTES[report['chosen']]}, {report['file_bytes']} bytes"
    )
    return 0


def evaluate(options: argparse.Namespace, noise_t: float) -> int:
    try:
        from fmfts_skin.calibrate.force_command import evaluate_force_file
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts_calibrate.evaluation import COVERAGE, printed
    from fmfts_calibrate.field_table import DataError
    from fmfts_skin.force_model import ForceModelError

    with ended_by(DataError, ForceModelError), unreadable_told(DataError, options.model):
        sources = [options.data, *options.sessions]
        judged = evaluate_force_file(sources, Path(options.model), _magnet(options, noise_t, asked=True))
    if options.json:
        print(json.dumps({"rows": judged.rows()}, indent=1))
        return 0
    print(printed(judged.rows()))
    print(COVERAGE)
    return 0


def _magnet(options: argparse.Namespace, noise_t: float, asked: bool) -> KnownMagnet | None:
    """The pad that --config names, if it has one magnet. asked: also if its contact model may need none."""
    from fmfts.cli.verb import configuration, pad_named
    from fmfts_skin.calibrate.force_command import KnownMagnet

    if options.config is None:
        if options.pad is not None or options.baseline is not None:
            raise VerbError(
                exit_codes.USAGE, "--pad and --baseline are of a pad in a configuration: give --config, too"
            )
        return None
    pad = pad_named(configuration(options), options.pad)
    if pad.other_magnets or not (pad.are_magnets_known or asked):
        return None
    return KnownMagnet(pad.pad(), pad.scene.solved, noise_t, options.baseline)
