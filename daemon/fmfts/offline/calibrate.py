"""`fmfts-daemon calibrate`: a calibration set → a contact model, and a report beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.evaluation import printed
from fmfts.calibrate.training import Options, Say, calibrate
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
    known = read_calibration_set(source, pad, pad_size_mm, baseline)
    known_shear = None
    if sheared is not None:
        known_shear = str(sheared), read_calibration_set(sheared, pad, pad_size_mm, baseline)
    made = calibrate(str(source), known, options, say, known_shear)
    target.write_bytes(made.model)
    target.with_suffix(".json").write_text(json.dumps(made.report, indent=1) + "\n")
    say("on the calibration set, as it is:\n" + printed(made.report["on_the_calibration_set"]))
    say("on new presses, with the noise of one frame:\n" + printed(made.report["on_new_presses_with_noise"]))
    return made.report
