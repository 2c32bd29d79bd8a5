"""What `calibrate` does with labelled fields of a pad whose magnets are unknown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fmfts_calibrate.command import report_of, write_model
from fmfts_calibrate.labelled_poses import Say
from fmfts_skin.calibrate.field_evaluate import evaluate_field
from fmfts_skin.calibrate.field_fit import make_response
from fmfts_skin.calibrate.field_set import read_field_set


def make_field_response(source: Path, target: Path, say: Say) -> dict[str, Any]:
    """Make a table from contact to field of the set in `source`; write it and its report; return the report.

    Raises DataError for a wrong set, OSError where the files cannot be written.
    """
    report = report_of(target, "MODEL.response")
    data = read_field_set(source)
    response = make_response(data, f"{source.name} {data.digest[:12]}", say)
    content = response.encoded()
    facts = {
        "data": source.name,
        "data_sha256": data.digest,
        "axes": [msgspec.structs.asdict(axis) for axis in response.axes],
        "sensors": len(response.reference_ut) // 3,
        "rests": response.rests,
        "deviation_ut": np.sqrt(np.diagonal(response.covariance.mean(axis=0))).round(1).tolist(),
        "on_the_calibration_set": evaluate_field(response, data, str(source)).facts(),
    }
    return write_model(target, content, report, facts)
