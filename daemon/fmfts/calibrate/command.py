"""`fmfts-daemon calibrate`: makes a contact model, and its report, from a calibration set."""

from __future__ import annotations

import json
import os
from errno import EISDIR
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.evaluation import printed
from fmfts.calibrate.field_table import DataError
from fmfts.calibrate.labelled_poses import Say
from fmfts.calibrate.training import Options, calibrate
from fmfts.pad import Pad


def make_model(
    source: Path,
    target: Path,
    pad: Pad,
    pad_size_mm: float,
    baseline: Path | None,
    options: Options,
    say: Say,
    sheared: Path | None = None,
) -> dict[str, Any]:
    """Make a model from the set in `source`; write it to `target`, and its report beside it (.json); return the report.

    sheared: a set with shear, for the errors that shear causes in a model without it. Raises DataError for a wrong set,
    OSError where the files cannot be written.
    """
    report = target.with_suffix(".json")
    if report == target:
        raise DataError(f"{target}: the model's report would have the same name, {report}: choose another (MODEL.onnx)")
    _require_writable(target)
    calibration = read_calibration_set(source, pad, pad_size_mm, baseline)
    shear_set = None
    if sheared is not None:
        shear_set = str(sheared), read_calibration_set(sheared, pad, pad_size_mm, baseline)
    calibrated = calibrate(str(source), calibration, options, say, shear_set)
    _replace(report, (json.dumps(calibrated.report, indent=1) + "\n").encode())
    _replace(target, calibrated.model)
    say("on the calibration set, as it is:\n" + printed(calibrated.report["on_the_calibration_set"]))
    say("on new presses, with the noise of one frame:\n" + printed(calibrated.report["on_new_presses_with_noise"]))
    return calibrated.report


def _require_writable(target: Path) -> None:
    """Raises OSError now rather than after minutes of training."""
    if target.is_dir():
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(target))
    with NamedTemporaryFile(dir=target.parent):
        pass


def _replace(target: Path, content: bytes) -> None:
    """Replaces the file in one step, because a running daemon may be reading it."""
    new = target.with_name(f"{target.name}.new")
    new.write_bytes(content)
    new.replace(target)
