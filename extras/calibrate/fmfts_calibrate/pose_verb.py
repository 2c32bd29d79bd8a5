"""Defines the verb `pose`: its options and what it prints."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fmfts.cli.verb import AddVerb, VerbError, configuration, configured_pad, not_written
from fmfts.common import exit_codes


def add_to(verb: AddVerb) -> None:
    """Add the verb. verb: makes a parser from a name, a handler and a line of help."""
    pose = verb("pose", _pose, "solve the magnet's pose for every row of a CSV file of fields")
    pose.add_argument("fields", type=Path, metavar="FIELD.csv")
    pose.add_argument("-o", "--output", type=Path, metavar="FILE", help="default: standard output")
    pose.add_argument("--pad", metavar="NAME", help="pad with this geometry and magnet; needed if there are several")
    pose.add_argument("--baseline", type=Path, metavar="FILE", help="the fields are raw: subtract this baseline")
    pose.add_argument("--sequence", action="store_true", help="start each row from the one before, not from rest")
    pose.add_argument(
        "--unknowns",
        type=int,
        choices=(5, 6, 8, 9),
        default=6,
        help="5: pose; 6: pose and moment; 8: pose and ambient field; 9: all three (default: 6). 5 and 8 take the "
        "moment as exact: the deviations do not include its error",
    )
    pose.add_argument(
        "--octupole",
        action="store_true",
        help="model the magnet as a cylinder, as `run` does; else as the paper's dipole",
    )
    pose.add_argument(
        "--gradient-ut-per-mm",
        type=float,
        default=0.0,
        help="standard deviation of the ambient field's gradient (0: no gradient; 0.3: steel, or a magnet 60 mm away)",
    )
    pose.add_argument("--neighbours", action="store_true", help="the magnets of the pad's scene.neighbours may move")
    pose.add_argument("--noise-ut", type=float, default=0.2, help="standard deviation of a field value (0.2)")


def _pose(options: argparse.Namespace) -> int:
    from fmfts_calibrate import field_table
    from fmfts_calibrate.neighbours import neighbours_at_rest
    from fmfts_calibrate.pose import PoseOptions, read_fields, solve_table

    pad_config = configured_pad(options)
    pad = pad_config.pad()
    if not options.noise_ut > 0.0:
        raise VerbError(exit_codes.USAGE, f"--noise-ut is {options.noise_ut}: it must be greater than zero")
    try:
        table = read_fields(options.fields, pad)
        pose_options = PoseOptions(
            options.baseline,
            options.sequence,
            options.noise_ut * 1e-6,
            options.unknowns,
            options.octupole,
            options.gradient_ut_per_mm * 1e-3,
            neighbours_at_rest(pad_config, configuration(options).pad) if options.neighbours else (),
        )
        columns = solve_table(table, pad, pose_options)
        if options.output is None:
            field_table.write(columns, sys.stdout)
        else:
            with options.output.open("w", newline="") as out:
                field_table.write(columns, out)
    except field_table.DataError as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    except BrokenPipeError:  # the reader of the output has ended; main handles it
        raise
    except OSError as error:
        raise not_written(error, options.output) from error
    return 0
