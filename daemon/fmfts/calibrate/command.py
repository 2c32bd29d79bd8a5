"""`fmfts-daemon calibrate`: a calibration set → a contact model, and a report beside it."""

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
    """Writes `target` and its report, `target` with .json; the report. DataError for a set that is not right.

    sheared: another set, for what shear does to a model that does not tell it.
    """
    report = target.with_suffix(".json")
    if report == target:
        raise DataError(
            f"{target}: the model's report goes beside it as {report}: name the model otherwise (MODEL.onnx)"
        )
    _require_writable(target)
    known = read_calibration_set(source, pad, pad_size_mm, baseline)
    known_shear = None
    if sheared is not None:
        known_shear = str(sheared), read_calibration_set(sheared, pad, pad_size_mm, baseline)
    made = calibrate(str(source), known, options, say, known_shear)
    _replace(report, (json.dumps(made.report, indent=1) + "\n").encode())
    _replace(target, made.model)
    say("on the calibration set, as it is:\n" + printed(made.report["on_the_calibration_set"]))
    say("on new presses, with the noise of one frame:\n" + printed(made.report["on_new_presses_with_noise"]))
    return made.report


def _require_writable(target: Path) -> None:
    """OSError now, and not after minutes of training."""
    if target.is_dir():
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(target))
    with NamedTemporaryFile(dir=target.parent):
        pass


def _replace(target: Path, content: bytes) -> None:
    """All of it or none: a running daemon may be reading the file that was there."""
    beside = target.with_name(f"{target.name}.new")
    beside.write_bytes(content)
    beside.replace(target)
