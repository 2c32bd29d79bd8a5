"""Fills the parameters of `now` that the fast path reads: pose/motion.h and contact/now.h."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.common.double_table import DoubleTable
from fmfts.contact import now as carrying
from fmfts.contact.drive import FORCE_DRIVE_N2_PER_S3, PLACE_DRIVE_MM2_PER_S3
from fmfts.contact.now import FORCE_RATE_N_PER_S, PLACE_RATE_M_PER_S
from fmfts.pad import Array
from fmfts.pose import motion


@dataclass(frozen=True, slots=True)
class NowParameters:
    """What `pipeline/now.py` knows of a pad, and its own constants. response: as in refine.h. to_pose, untouched_drive
    (5, 5): see contact/drive.py."""

    response: bytes
    to_pose: Array
    untouched_drive: Array
    surprise_chi2: float
    period_us: float
    lead_us: float
    early_lead_us: float
    early_chi2: float
    let_go: float
    jump_periods: float
    settled_frames: int
    longest_lead_s: float


def put_now(parameters: DoubleTable, now: NowParameters | None) -> None:
    """now: None of a pad whose messages do not tell it."""
    parameters.put("tells_now", now is not None)
    if now is None:
        return
    parameters.put("weights", np.array(motion.WEIGHTS))
    parameters.put("switches_per_s", motion.SWITCHES_PER_S)
    parameters.put("calm_s", motion.CALM_S)
    parameters.put("largest_tilt", motion.LARGEST_TILT)
    parameters.put("lasting_share", motion.LASTING_SHARE)
    parameters.put("late_us", motion.LATE_US)
    for name in ("surprise_chi2", "early_chi2", "period_us", "lead_us", "early_lead_us"):
        parameters.put(name, getattr(now, name))
    for name in ("let_go", "jump_periods", "settled_frames", "longest_lead_s"):
        parameters.put(name, getattr(now, name))
    parameters.put("to_pose", now.to_pose)
    parameters.put("untouched_drive", now.untouched_drive)
    place = PLACE_DRIVE_MM2_PER_S3
    loads = np.ones(3)  # force, and shear of a model that tells it
    parameters.put("drive_power", np.array([place, place, *FORCE_DRIVE_N2_PER_S3 * loads]))
    parameters.put("acceleration_power", np.array([place * 1e-6, place * 1e-6, *FORCE_DRIVE_N2_PER_S3 * loads]))
    parameters.put("usual_rate", np.array([PLACE_RATE_M_PER_S, PLACE_RATE_M_PER_S, *FORCE_RATE_N_PER_S * loads]))
    parameters.put("lead_share", carrying.LEAD_SHARE)
    parameters.put("ahead_s", carrying.AHEAD_S)
