"""`calibrate --correct` for a pad with one magnet: few presses correct the configured contact model."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from fmfts.cli.verb import WEIGH_FIRST, VerbError, ended_by, lacking, refuse_options, say, written_to
from fmfts.common import exit_codes

if TYPE_CHECKING:
    from fmfts.baseline import Baseline
    from fmfts.config import PadConfig
    from fmfts.pad import Array
    from fmfts_calibrate.pad_fit import StartingModel
    from fmfts_calibrate.pad_set import MountedPad

PLACE_SD_MM, LARGEST_PLACE_SD_MM = 0.5, 5.0
SCALE_SD, LARGEST_SCALE_SD = 0.01, 0.3


def correct(options: argparse.Namespace, pad: PadConfig, noise_t: float) -> int:
    why = "makes a model from a whole set of presses, and --correct corrects the configured one"
    refuse_options(options, ("shear", "sheared", "hidden", "start"), why)
    place_sd_mm = PLACE_SD_MM if options.place_sd_mm is None else options.place_sd_mm
    scale_sd = SCALE_SD if options.scale_sd is None else options.scale_sd
    if not 0.0 < place_sd_mm <= LARGEST_PLACE_SD_MM:
        raise VerbError(exit_codes.USAGE, f"--place-sd-mm is {place_sd_mm:g}: more than 0, up to 5 mm")
    if not 0.0 <= scale_sd <= LARGEST_SCALE_SD:
        why = f"--scale-sd is {scale_sd:g}: a share from 0 to {LARGEST_SCALE_SD:g}"
        raise VerbError(exit_codes.USAGE, f"{why}; if another pad gave the forces, {WEIGH_FIRST}")
    try:
        from fmfts_calibrate.command import CorrectionJob, make_corrected_model
    except ImportError as error:
        raise lacking(error, "calibrate") from error
    from fmfts.baseline import BaselineError
    from fmfts.contact import ModelError
    from fmfts_calibrate.array_set import baseline_of
    from fmfts_calibrate.field_table import DataError

    with ended_by(DataError, ModelError, BaselineError), written_to(options.output):
        baseline = baseline_of(options.baseline, pad.pad())
        start = starting_model(pad, baseline)
        mounted = mounted_pad(pad, baseline, start, noise_t)
        job = CorrectionJob(mounted, start, options.pad_size_mm, place_sd_mm, scale_sd)
        report = make_corrected_model(options.data, options.output, job, say)
    if options.json:
        print(json.dumps(report, indent=1))
        return 0
    print(
        f"{options.output}: model {report['model']}, {report['file_bytes']} bytes, corrected by "
        f"{report['presses']} presses ({report['chosen']}): the silicone is {report['stiffness']:.2f} times as stiff "
        "as the start's; set [pad.contact] model to it"
    )
    return 0


def starting_model(pad: PadConfig, baseline: Baseline) -> StartingModel:
    """The configured contact model, with the stiffness by a known weight. Raises ModelError."""
    from fmfts.pipeline.configured import load_contact_model
    from fmfts_calibrate.pad_fit import StartingModel

    model, silicone = load_contact_model(pad), baseline.silicone
    is_weighed = silicone is not None and silicone.model == model.hash
    return StartingModel(model, silicone.stiffness if silicone is not None and is_weighed else 1.0)


def mounted_pad(pad: PadConfig, baseline: Baseline, start: StartingModel, noise_t: float) -> MountedPad:
    """The pad with its baseline. Raises BaselineError."""
    import numpy as np

    from fmfts.contact.model import POSE_UNIT
    from fmfts.pipeline.baselined_pad import BaselinedPad
    from fmfts.scene.tracking import scene_model_of
    from fmfts_calibrate.pad_set import MountedPad
    from fmfts_calibrate.single_frames import SingleFrames

    drawing = pad.pad()
    baselined = BaselinedPad.of(drawing, baseline, scene_model_of(pad).tracking)
    rest = np.concatenate([drawing.rest_position_m, drawing.rest_axis])

    def place_of(change: Array, covariance: Array) -> Array:
        """The stiffness changes no place."""
        pose, spread = rest * POSE_UNIT, np.zeros((6, 6))
        pose[:5] += change
        pose[5] = np.sqrt(max(1.0 - np.sum(np.square(pose[3:5])), 0.0))
        spread[:5, :5] = covariance
        position_m, axis = np.split(pose / POSE_UNIT, 2)
        contact = start.model.estimate(position_m, axis, spread / POSE_UNIT / POSE_UNIT[:, None])
        return np.array([contact.x_m, contact.y_m]) * 1e3

    pose_of = SingleFrames(baselined, noise_t).change
    return MountedPad(drawing, baselined.mounting, baseline.id, pose_of, place_of)
