"""`calibrate` and `evaluate` for pads whose magnets are unknown: from contact to field, without a configuration."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from fmfts.cli.verb import ended_by, lacking, refuse_options, say, written_to
from fmfts.common.reading import read_regular, unreadable_told
from fmfts_calibrate.kinds import OF_PRESSES, begins_with, columns_of

OF_COLLECT = "first_frame_ns"
MARK = b"fmfts field response"


def is_of_fields(data: Path) -> bool:
    """Whether a set has columns that only such a pad needs: a depth, shear alone, rest rows or recordings."""
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
    from fmfts_calibrate.field_table import DataError

    why = (
        f"{options.data} is of a pad whose magnets are unknown (it has depth_mm, shear_n, rest or recording); its "
        "table is made without that option"
    )
    refuse_options(options, ("shear", "sheared", "hidden", "baseline", "pad", "correct", *OF_PRESSES), why)
    with ended_by(DataError), written_to(options.output):
        report = make_field_response(options.data, options.output, say)
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
    from fmfts_calibrate.evaluation import COVERAGE, printed
    from fmfts_calibrate.field_table import DataError
    from fmfts_skin.calibrate.field_set import read_field_set
    from fmfts_skin.field_response import LARGEST_BYTES, FieldResponse, FieldResponseError

    with ended_by(DataError, FieldResponseError), unreadable_told(DataError, options.model):
        content = read_regular(Path(options.model), LARGEST_BYTES)
        response = FieldResponse.of(content, options.model)
        data = read_field_set(options.data)
        evaluation = evaluate_field(response, data, str(options.data), learn=not options.as_recorded)
    if options.json:
        print(json.dumps(evaluation.facts(), indent=1))
        return 0
    for name, one in evaluation.instances.items():
        print(f"recording {name or '(unnamed)'}: moment {one.moment:+.2%}, gain {one.gain:+.1%} of the table's pad")
    print(printed(evaluation.rows()))
    print(COVERAGE)
    return 0
