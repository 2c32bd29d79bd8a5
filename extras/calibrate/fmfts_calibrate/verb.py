"""Defines the verbs `calibrate` and `evaluate`: their options and what they print."""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli.verb import (
    AddVerb,
    VerbError,
    configured_pad,
    ended_by,
    lacking,
    refuse_options,
    say,
    written_to,
)
from fmfts.common import exit_codes
from fmfts_calibrate import correct_verb, several_verb
from fmfts_calibrate.kinds import OF_PRESSES, calibration_of_model, calibration_of_set, require_one_file
from fmfts_calibrate.workers import add_workers, workers_of

if TYPE_CHECKING:
    from fmfts.config import PadConfig

log = logging.getLogger("fmfts")


def add_calibrate(verb: AddVerb) -> None:
    """Add the verb. verb: makes a parser from a name, a handler and a line of help."""
    calibrate = verb("calibrate", _calibrate, "make a contact model from a CSV file of labelled fields")
    calibrate.add_argument("data", type=Path, metavar="DATA.csv")
    calibrate.add_argument("-o", "--output", type=Path, metavar="MODEL.onnx", required=True)
    calibrate.add_argument(
        "--presses", type=int, default=20000, metavar="N", help="number of presses to train on (20000)"
    )
    calibrate.add_argument("--shear", action="store_true", help="also estimate tangential force")
    calibrate.add_argument(
        "--sheared",
        type=Path,
        metavar="SET.csv",
        help="presses with shear: the errors it causes in this model; with --shear: what it does to the magnet",
    )
    calibrate.add_argument(
        "--hidden", type=int, metavar="N", help="size of the model's layers (default: found by selection)"
    )
    calibrate.add_argument(
        "--start",
        type=Path,
        metavar="TABLE.response",
        help="of a pad with several magnets: the table of presses to correct (the shipped one)",
    )
    calibrate.add_argument(
        "--correct",
        action="store_true",
        help="correct the configured contact model by few presses, 5 to 18, instead of making one of 150 or more",
    )
    calibrate.add_argument(
        "--place-sd-mm",
        type=float,
        metavar="MM",
        help="with --correct: deviation of the places of the presses (0.5: by hand; of a stage 0.05)",
    )
    calibrate.add_argument(
        "--scale-sd",
        type=float,
        metavar="SHARE",
        help="with --correct: common relative error of all forces, such as a gauge's scale (0.01)",
    )
    calibrate.add_argument(
        "--route",
        choices=("field", "pose", "both"),
        help="of a set with force_x_n, force_y_n and force_z_n: how to get there (field or both, whichever errs less)",
    )
    add_workers(calibrate, "for the folds by which --hidden is found")
    _add_shared(calibrate)


def add_evaluate(verb: AddVerb) -> None:
    """The same."""
    evaluate = verb("evaluate", _evaluate, "compare a contact model's answers with a CSV file of labelled fields")
    evaluate.add_argument("data", type=Path, metavar="TEST.csv")
    evaluate.add_argument(
        "--model",
        metavar="MODEL.onnx",
        help="model to judge (that of [pad.contact]); refine and friction are those of [pad.contact]",
    )
    evaluate.add_argument(
        "--as-recorded",
        action="store_true",
        help="with the model of a pad of unknown magnets: learn nothing of the test's own pad from its fields",
    )
    evaluate.add_argument("--plot", type=Path, metavar="FILE.png", help="draw a map of the errors")
    _add_shared(evaluate)


def _add_shared(added: argparse.ArgumentParser) -> None:
    added.add_argument(
        "sessions",
        type=Path,
        nargs="*",
        metavar="SESSION.csv",
        help="of sets with force_x_n, force_y_n and force_z_n: further sessions (another day, another mounting)",
    )
    added.add_argument("--pad", metavar="NAME", help="pad with this geometry and magnet; needed if there are several")
    added.add_argument("--pad-size-mm", type=float, default=40.0, metavar="MM", help="edge of the square pad (40)")
    added.add_argument(
        "--baseline",
        type=Path,
        metavar="FILE",
        help="the fields are raw: subtract this baseline (of several magnets: that of these presses)",
    )
    added.add_argument("--noise-ut", type=float, default=0.2, metavar="UT", help="noise of a field value (0.2: 2 mG)")
    added.add_argument("--json", action="store_true", help="print facts as JSON")


def _pad(options: argparse.Namespace) -> PadConfig:
    """The configured pad; without any configuration, the standard pad. Raises VerbError."""
    from fmfts.config import PadConfig, SimulatedSource
    from fmfts.config.file import is_there_any

    if options.pad is None and not is_there_any(options.config):
        log.info("no configuration: the standard pad")
        return PadConfig(name="standard", source=SimulatedSource())
    return configured_pad(options, several=True)


def _calibrate(options: argparse.Namespace) -> int:
    if not options.correct:
        refuse_options(options, OF_PRESSES, "is for --correct alone: add that, or leave it out")
    if (other := calibration_of_set(options.data)) is not None:
        return other.calibrate(options, _noise_t(options))
    require_one_file(options)
    pad = _pad(options)
    if pad.other_magnets:
        return several_verb.calibrate(options, pad, _noise_t(options))
    if options.correct:
        return correct_verb.correct(options, pad, _noise_t(options))
    if options.start is not None:
        raise VerbError(exit_codes.USAGE, f"--start is for pads with several magnets, and pad {pad.name!r} has one")
    try:
        from fmfts_calibrate.command import make_model
        from fmfts_calibrate.training import Options
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.view.progress import progress_bar
    from fmfts_calibrate.field_table import DataError
    from fmfts_calibrate.sweep import ClusterError

    if options.hidden is not None and not 2 <= options.hidden <= 64:
        raise VerbError(exit_codes.USAGE, f"--hidden is {options.hidden}: from 2 to 64")
    if options.presses < 100:
        raise VerbError(exit_codes.USAGE, f"--presses is {options.presses}: at least 100")
    training = Options(
        scene=pad.scene.solved,
        noise_t=_noise_t(options),
        hidden=options.hidden,
        presses=options.presses,
        shear=options.shear,
        workers=workers_of(options),
    )
    with ended_by(DataError, ClusterError), written_to(options.output), progress_bar("calibrate") as show:
        report = make_model(
            options.data,
            options.output,
            pad.pad(),
            options.pad_size_mm,
            options.baseline,
            training,
            say,
            options.sheared,
            show,
        )
    if options.json:
        print(json.dumps(report, indent=1))
    else:
        print(f"{options.output}: model {report['model']}, {report['file_bytes']} bytes; set [pad.contact] model to it")
    return 0


def _evaluate(options: argparse.Namespace) -> int:
    if options.model is not None and (other := calibration_of_model(Path(options.model))) is not None:
        return other.evaluate(options, _noise_t(options))
    require_one_file(options)
    pad = _pad(options)
    if pad.other_magnets:
        return several_verb.evaluate(options, pad, _noise_t(options))
    try:
        from fmfts_calibrate.evaluate import evaluate
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.contact import ModelError
    from fmfts.contact.unknown_shear import SHEAR_UNKNOWN
    from fmfts.pipeline.configured import load_contact_model
    from fmfts_calibrate.dataset import read_labelled
    from fmfts_calibrate.evaluation import firm_and_central, printed
    from fmfts_calibrate.field_table import DataError

    try:
        model = load_contact_model(pad, options.model)
        labelled = read_labelled(options.data, pad.pad(), options.pad_size_mm, options.baseline)
        if model.shear_is_unknown:
            say(f"warning: {SHEAR_UNKNOWN.format(friction=model.friction)}")
        if labelled.digest == model.facts.data:
            say("note: the model was made from these very presses: on others its errors are larger")
        evaluation = evaluate(labelled, options.data, model, pad.scene.solved, _noise_t(options))
        if options.plot is not None:
            _draw(evaluation, options.plot)
    except (DataError, ModelError) as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    if options.json:
        print(json.dumps(evaluation.facts(), indent=1))
        return 0
    over_range = int((~evaluation.in_range).sum())
    how = f"refine = {str(model.refines).lower()}, friction = {model.friction:g}"
    print(f"model {evaluation.model} ({how}), {len(evaluation.press)} presses, {over_range} of them over range")
    if evaluation.in_range.any():
        print(printed(evaluation.rows()))
        print(firm_and_central(evaluation.press[evaluation.in_range], evaluation.found[evaluation.in_range]))
        print("mae, rmse: mean absolute and rms errors; in_sd: rms of error / the model's deviation, ideally 1")
    return 0


def _draw(evaluation: object, target: Path) -> None:
    try:
        from fmfts_calibrate.evaluation_plot import draw
    except ImportError as error:
        raise lacking(error, "plot") from error
    try:
        with written_to(target):
            draw(evaluation, target)  # type: ignore[arg-type]
    except ValueError as error:  # matplotlib does not know the suffix
        raise VerbError(exit_codes.USAGE, f"{target}: {error}") from error


def _noise_t(options: argparse.Namespace) -> float:
    if not 0.0 < options.noise_ut < 100.0:
        raise VerbError(exit_codes.USAGE, f"--noise-ut is {options.noise_ut}: greater than zero, in µT")
    return float(options.noise_ut) * 1e-6
