"""`calibrate` and `evaluate` for pads with several known magnets: a table of presses, from labelled presses."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli.verb import VerbError, ended_by, lacking, refuse_options, say, written_to
from fmfts.common import exit_codes
from fmfts_calibrate.kinds import OF_PRESSES

if TYPE_CHECKING:
    from fmfts.config import PadConfig
    from fmfts_calibrate.command import ArrayJob


def calibrate(options: argparse.Namespace, pad: PadConfig, noise_t: float) -> int:
    _refuse(options, pad, "shear", "sheared", "hidden", *OF_PRESSES)
    try:
        from fmfts_calibrate.command import make_array_response
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts_calibrate.field_table import DataError

    with ended_by(DataError), written_to(options.output):
        job = _job(options, pad, noise_t)
        report = make_array_response(options.data, options.output, job, options.start, say)
    if options.json:
        print(json.dumps(report, indent=1))
        return 0
    print(
        f"{options.output}: table of presses {report['model']}, {report['file_bytes']} bytes, up to "
        f"{report['largest_force_n']:g} N; set [pad.contact] model to it"
    )
    return 0


def evaluate(options: argparse.Namespace, pad: PadConfig, noise_t: float) -> int:
    _refuse(options, pad, "plot", "as_recorded")
    try:
        from fmfts_calibrate.command import evaluate_array_model
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.contact import ModelError
    from fmfts.contact.array_model import ARRAY_PATH
    from fmfts.contact.no_model import NO_MODEL
    from fmfts.pipeline.configured import DEFAULT_MODEL
    from fmfts_calibrate.evaluation import printed
    from fmfts_calibrate.field_table import DataError

    name = options.model or pad.contact.model
    if name == NO_MODEL:
        raise VerbError(exit_codes.USAGE, f"pad {pad.name!r} has no contact model: name the one to judge with --model")
    model = ARRAY_PATH if name == DEFAULT_MODEL else Path(name)
    try:
        evaluation = evaluate_array_model(options.data, model, _job(options, pad, noise_t), say)
    except (DataError, ModelError) as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    if options.json:
        print(json.dumps(evaluation.facts(), indent=1))
        return 0
    told = ", ".join(f"{name} {count}" for name, count in evaluation.counted().items())
    print(f"table of presses {evaluation.model}, {len(evaluation.press)} presses of one finger; told: {told}")
    if evaluation.answered.any():
        print(printed(evaluation.rows()))
        print(
            "mae, rmse: mean absolute and rms errors; in_sd: rms of error / stated deviation, ideally 1; within_2: "
            "share within two of them, ideally 0.95; wrong: healthy, and more than five off"
        )
    return 0


def _job(options: argparse.Namespace, pad: PadConfig, noise_t: float) -> ArrayJob:
    from fmfts.pipeline.configured import several_scene_of
    from fmfts_calibrate.command import ArrayJob

    return ArrayJob(
        pad.pad(), several_scene_of(pad), float(pad.source.rate_hz), noise_t, options.pad_size_mm, options.baseline
    )


def _refuse(options: argparse.Namespace, pad: PadConfig, *names: str) -> None:
    why = f"pad {pad.name!r} has several magnets, and what is made for it is a table of presses, without that option"
    refuse_options(options, names, why)
