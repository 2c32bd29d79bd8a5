"""`fmfts-daemon calibrate`: makes a contact model, and its report, from a calibration set."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from errno import EISDIR
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from fmfts.contact.array_model import ArrayModel
from fmfts.contact.seal import hash_of
from fmfts.pad import Pad
from fmfts.several.field_model import Scene
from fmfts.view.progress import Show, unseen
from fmfts_calibrate.array_evaluate import ArrayEvaluation, evaluate_array
from fmfts_calibrate.array_fit import fit_table
from fmfts_calibrate.array_set import read_array_set
from fmfts_calibrate.array_start import starting_table
from fmfts_calibrate.dataset import read_calibration_set
from fmfts_calibrate.evaluation import printed
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.pad_fit import StartingModel, correct_model
from fmfts_calibrate.pad_set import MountedPad, read_pose_set
from fmfts_calibrate.training import Options, calibrate


def make_model(
    source: Path,
    target: Path,
    pad: Pad,
    pad_size_mm: float,
    baseline: Path | None,
    options: Options,
    say: Say,
    sheared: Path | None = None,
    show: Show = unseen,
) -> dict[str, Any]:
    """Make a model from the set in `source`; write it to `target`, and its report beside it (.json); return the report.

    show: takes the share that is done.
    sheared: a set with shear, for the errors that shear causes in a model without it. Raises DataError for a wrong set,
    OSError where the files cannot be written.
    """
    report = report_of(target, "MODEL.onnx")
    calibration = read_calibration_set(source, pad, pad_size_mm, baseline)
    shear_set = None
    if sheared is not None:
        shear_set = str(sheared), read_calibration_set(sheared, pad, pad_size_mm, baseline)
    calibrated = calibrate(str(source), calibration, options, say, shear_set, show)
    replace_file(report, (json.dumps(calibrated.report, indent=1) + "\n").encode())
    replace_file(target, calibrated.model)
    say("on the calibration set, as it is:\n" + printed(calibrated.report["on_the_calibration_set"]))
    say("on new presses, with the noise of one frame:\n" + printed(calibrated.report["on_new_presses_with_noise"]))
    say(calibrated.report["firm_and_central"])
    return calibrated.report


@dataclass(frozen=True, slots=True)
class ArrayJob:
    """A pad with several magnets as calibrate and evaluate need it. noise_t: of one frame's value. baseline: a file;
    None: the pad's own."""

    pad: Pad
    scene: Scene
    rate_hz: float
    noise_t: float
    pad_size_mm: float
    baseline: Path | None


def make_array_response(source: Path, target: Path, job: ArrayJob, start: Path | None, say: Say) -> dict[str, Any]:
    """Make a table of presses of a pad with several magnets, as a correction of another one (None: the shipped one).

    Writes it and its report; returns the report. Raises as `make_model`.
    """
    report = report_of(target, "MODEL.response")
    data = read_array_set(source, job.pad, job.pad_size_mm, job.baseline, say)
    made = fit_table(data, str(source), starting_table(start, job.pad), job.noise_t, say)
    content = made.response.encoded()
    model = hash_of(content)
    judged = evaluate_array(data, ArrayModel(made.response, model), job.scene, job.rate_hz, job.noise_t)
    facts = {
        "data": source.name,
        "data_sha256": data.digest,
        "baseline": data.baseline,
        "presses": len(data.press),
        "corrections": [level.facts() for level in made.levels],
        "chosen": made.chosen,
        "force_factor": round(made.force_factor, 4),
        "largest_force_n": round(made.response.scale_n, 3),
        "error": made.response.error,
        "on_the_calibration_set": judged.facts(),
    }
    return write_model(target, content, report, facts)


@dataclass(frozen=True, slots=True)
class CorrectionJob:
    """A pad with one magnet as `calibrate --correct` needs it. place_mm: deviation of the places of presses. scale:
    common relative error of all forces of the set."""

    mounted: MountedPad
    start: StartingModel
    pad_size_mm: float
    place_mm: float
    scale: float


def make_corrected_model(source: Path, target: Path, job: CorrectionJob, say: Say) -> dict[str, Any]:
    """Correct a contact model by the few presses in `source`. Writes it and its report; returns the report. Raises as
    `make_model`."""
    report = report_of(target, "MODEL.onnx")
    data = read_pose_set(source, job.mounted, job.pad_size_mm, job.place_mm, say)
    made = correct_model(data, str(source), job.start, job.mounted.pad, job.scale, say)
    facts = {
        "data": source.name,
        "data_sha256": data.digest,
        "baseline": job.mounted.baseline,
        "start": job.start.model.hash,
        "presses": len(data.press),
        "scale_sd": job.scale,
    }
    return write_model(target, made.model, report, facts | made.facts)


def evaluate_array_model(source: Path, model: Path, job: ArrayJob, say: Say) -> ArrayEvaluation:
    """The answers of the model at `model` for the presses in `source`. DataError, ModelError as their readers raise
    them."""
    loaded = ArrayModel.load(model, job.pad)
    data = read_array_set(source, job.pad, job.pad_size_mm, job.baseline, say)
    return evaluate_array(data, loaded, job.scene, job.rate_hz, job.noise_t)


def report_of(target: Path, example: str) -> Path:
    """The path of a model's report, beside the model. DataError where that is the model itself, OSError if not
    writable.
    """
    report = target.with_suffix(".json")
    if report == target:
        raise DataError(f"{target}: the model's report would have the same name: choose another ({example})")
    _require_writable(target)
    return report


def _require_writable(target: Path) -> None:
    """Raises OSError now, not after minutes of training."""
    if target.is_dir():
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(target))
    with NamedTemporaryFile(dir=target.parent):
        pass


def write_model(target: Path, content: bytes, report: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Write a model and its report: its hash and size, and `facts` of it. Returns the report."""
    whole = {"model": hash_of(content), "file_bytes": len(content)} | facts
    replace_file(report, (json.dumps(whole, indent=1) + "\n").encode())
    replace_file(target, content)
    return whole


def replace_file(target: Path, content: bytes) -> None:
    """Replaces the file in one step, because a running daemon may read it."""
    new = target.with_name(f"{target.name}.new")
    new.write_bytes(content)
    new.replace(target)
