"""A contact model's answers to solved poses, one frame at a time, as in a running pad."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.contact import ContactEstimate, ContactModel
from fmfts.contact.model import POSE_UNIT
from fmfts_calibrate.tracked import Tracked
from fmfts_lab.bench.workspace import Array

MM = np.array([1e3, 1e3, 1.0])


@dataclass(frozen=True, slots=True)
class Answers:
    """found, deviation (K, 3) in mm and N."""

    found: Array
    deviation: Array


def estimates(model: ContactModel, tracked: Tracked) -> list[ContactEstimate]:
    out = []
    for pose, covariance in zip(tracked.pose, tracked.covariance, strict=True):
        whole = np.zeros((6, 6))
        whole[:5, :5] = covariance
        position_m, axis = np.split(pose / POSE_UNIT, 2)
        out.append(model.estimate(position_m, axis, whole / POSE_UNIT / POSE_UNIT[:, None]))
    return out


def answers(model: ContactModel, tracked: Tracked) -> Answers:
    found = estimates(model, tracked)
    return Answers(
        np.array([[one.x_m, one.y_m, one.force_n] for one in found]) * MM,
        np.array([[one.x_sd_m, one.y_sd_m, one.force_sd_n] for one in found]) * MM,
    )
