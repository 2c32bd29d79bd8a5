"""`calibrate` and `evaluate` for sets with forces in three directions, of any pad, with or without a configuration."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli.verb import VerbError, configured_pad, lacking, not_written
from fmfts.common import exit_codes
from fmfts.common.kind_of_file import begins_with, columns_of

if TYPE_CHECKING:
    from fmfts_skin.calibrate.force_command import KnownMagnet

MARK = b"fmfts force model"


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
    from fmfts.calibrate.field_table import DataError

    if given := [name for name in ("shear", "sheared", "hidden", "start") if getattr(options, name)]:
        raise VerbError(
            exit_codes.USAGE, f"--{given[0]}: {options.data} has force_x_n, force_y_n and force_z_n: leave it out"
        )
    try:
        sources = [options.data, *options.sessions]
        report = make_force_file(sources, options.output, _magnet(options, noise_t), options.route, _say)
    except DataError as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    except OSError as error:
        raise not_written(error, options.output) from error
    if options.json:
        print(json.dumps(report, indent=1))
        return 0
    for route in report["routes"]:
        print(f"{route['route']} route, errors on left-out {route['left_out']}:")
        _print_rows(route["rows"])
    print(
        f"{options.output}: force model {report['model']} by the {report['chosen']} route, {report['file_bytes']} bytes"
    )
    return 0


def evaluate(options: argparse.Namespace, noise_t: float) -> int:
    try:
        from fmfts_skin.calibrate.force_command import evaluate_force_file
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.calibrate.field_table import DataError
    from fmfts_skin.force_model import ForceModelError

    try:
        sources = [options.data, *options.sessions]
        judged = evaluate_force_file(sources, Path(options.model), _magnet(options, noise_t))
    except (DataError, ForceModelError) as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    except OSError as error:
        raise VerbError(exit_codes.DATA, f"{options.model}: cannot be read: {error.strerror}") from error
    if options.json:
        print(json.dumps({"rows": judged.rows()}, indent=1))
        return 0
    _print_rows(judged.rows())
    print("within_2, beyond_5: share of errors within two, and beyond five, of the stated deviations")
    return 0


def _magnet(options: argparse.Namespace, noise_t: float) -> KnownMagnet | None:
    """The pad that --config names, if it has one magnet that is known."""
    from fmfts.cli.verb import configuration, pad_named
    from fmfts_skin.calibrate.force_command import KnownMagnet

    if options.config is None:
        if options.pad is not None or options.baseline is not None:
            raise VerbError(
                exit_codes.USAGE, "--pad and --baseline are of a pad in a configuration: give --config, too"
            )
        return None
    pad = pad_named(configuration(options), options.pad)
    if pad.other_magnets or not pad.are_magnets_known:
        return None
    pad = configured_pad(options)
    return KnownMagnet(pad.pad(), pad.scene.ambient, noise_t, options.baseline)


def _print_rows(rows: list[dict[str, float | str]]) -> None:
    from fmfts.calibrate.evaluation import printed

    print(printed(rows))


def _say(line: str) -> None:
    print(line, file=sys.stderr)
