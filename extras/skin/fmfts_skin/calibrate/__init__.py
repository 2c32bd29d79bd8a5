"""What `calibrate` and `evaluate` do with the sets and models of pads whose magnets are unknown, or do not matter.

The functions here are what `fmfts-daemon` asks for (fmfts_calibrate.kinds.Calibration).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from fmfts_calibrate.kinds import require_one_file
from fmfts_skin.calibrate import fields, forces


def is_set(data: Path) -> bool:
    return forces.is_of_forces(data) or fields.is_of_fields(data)


def is_model(model: Path) -> bool:
    return forces.is_force_model(model) or fields.is_response(model)


def calibrate(options: argparse.Namespace, noise_t: float) -> int:
    if forces.is_of_forces(options.data):
        return forces.calibrate(options, noise_t)
    require_one_file(options)
    return fields.calibrate(options)


def evaluate(options: argparse.Namespace, noise_t: float) -> int:
    if forces.is_force_model(Path(options.model)):
        return forces.evaluate(options, noise_t)
    require_one_file(options)
    return fields.evaluate(options)
