"""`calibrate` and `evaluate` for pads whose magnets are unknown: from contact to field, without a configuration."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from fmfts.cli.verb import VerbError, lacking, not_written
from fmfts.common import exit_codes
from fmfts.common.kind_of_file import begins_with, columns_of
from fmfts.common.reading import read_regular

OF_COLLECT = "first_frame_ns"
MARK = b"fmfts field response"


def is_of_fields(data: Path) -> bool:
    """Whether a set names what only such a pad's has: a depth, shear alone, rest rows or recordings."""
    names = columns_of(data)
    # A table that `collect` wrote names the recording of its frames; such a pad's magnets are known.
    return bool({"depth_mm", "shear_n", "rest", "recording"} & names) and OF_COLLECT not in names


def is_response(model: Path) -> bool:
    return begins_with(model, MARK)


def calibrate(options: argparse.Namespace) -> int:
    try:
        from fmfts_skin.calibrate.field_command import make_field_response
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.calibrate.field_table import DataError

    given = [name for name in ("shear", "sheared", "hidden", "baseline", "pad") if getattr(options, name)]
    if given:
        raise VerbError(
            exit_codes.USAGE,
            f"--{given[0]}: {options.data} is of a pad whose magnets are unknown (it has depth_mm, shear_n, rest or "
            "recording); its table is made without that option",
        )
    try:
        report = make_field_response(options.data, options.output, _say)
    except DataError as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    except OSError as error:
        raise not_written(error, options.output) from error
    if options.json:
        print(json.dumps(report, indent=1))
    else:
        print(f"{options.output}: field response {report['model']}, {report['file_bytes']} bytes")
    return 0


def evaluate(options: argparse.Namespace) -> int:
    try:
        from fmfts_skin.calibrate.field_evaluate import evaluate_field
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.calibrate.evaluation import printed
    from fmfts.calibrate.field_table import DataError
    from fmfts_skin.calibrate.field_set import read_field_set
    from fmfts_skin.field_response import LARGEST_BYTES, FieldResponse, FieldResponseError

    try:
        content = read_regular(Path(options.model), LARGEST_BYTES)
        response = FieldResponse.of(content, options.model)
        data = read_field_set(options.data)
        evaluation = evaluate_field(response, data, str(options.data), learn=not options.as_recorded)
    except (DataError, FieldResponseError) as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    except OSError as error:
        raise VerbError(exit_codes.DATA, f"{options.model}: cannot be read: {error.strerror}") from error
    if options.json:
        print(json.dumps(evaluation.facts(), indent=1))
        return 0
    for name, one in evaluation.instances.items():
        print(f"recording {name or '(unnamed)'}: moment {one.moment:+.2%}, gain {one.gain:+.1%} of the table's pad")
    print(printed(evaluation.rows()))
    print("within_2, beyond_5: share of errors within two, and beyond five, of the stated deviations")
    return 0


def _say(line: str) -> None:
    print(line, file=sys.stderr)
