"""`fmfts-daemon evaluate`: how far a contact model's answers are from a test set's labels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.calibrate.dataset import CalibrationSet, read_labelled, rest_field
from fmfts.calibrate.evaluation import Row, rows
from fmfts.calibrate.tracked import FrameSolver, Scene, Tracked
from fmfts.calibrate.training import NOISE_T, solved
from fmfts.contact import ContactModel
from fmfts.contact.model import POSE_UNIT
from fmfts.pad import Array, Pad

CONTACT_UNIT = np.array([1e3, 1e3, 1.0])  # m → mm; newtons stay


@dataclass(frozen=True, slots=True)
class Evaluation:
    """press (K, m): what the labels say; found (K, m), deviation (K, m): what the model says, in mm and N. in_range
    (K,): presses that the model does not call over range, which alone have numbers to compare."""

    press: Array
    found: Array
    deviation: Array
    in_range: NDArray[np.bool_]
    model: str

    def rows(self) -> list[Row]:
        """Errors by region, of the presses in range."""
        return rows(self.press[self.in_range], self.found[self.in_range], self.deviation[self.in_range])

    def facts(self) -> dict[str, Any]:
        return {
            "model": self.model,
            "presses": len(self.press),
            "over_range": int((~self.in_range).sum()),
            "regions": self.rows() if self.in_range.any() else [],
        }


def evaluate(
    source: Path, pad: Pad, model: ContactModel, scene: Scene, pad_size_mm: float, noise_t: float = NOISE_T
) -> Evaluation:
    """Every row of `source` is a frame of its own. DataError for a set that is not right."""
    labelled = read_labelled(source, pad, pad_size_mm)
    solver = FrameSolver(pad, rest_field(labelled), scene, noise_t)
    return judge(labelled, solved(str(source), labelled, solver), model)


def judge(labelled: CalibrationSet, tracked: Tracked, model: ContactModel) -> Evaluation:
    """What `model` makes of the poses, beside the labels."""
    outputs = min(len(model.facts.outputs), labelled.press.shape[1])
    found, deviation, in_range = [], [], []
    for pose, covariance in zip(tracked.pose, tracked.covariance, strict=True):
        whole = np.zeros((6, 6))
        whole[:5, :5] = covariance
        position_m, axis = np.split(pose / POSE_UNIT, 2)
        contact = model.estimate(position_m, axis, whole / POSE_UNIT / POSE_UNIT[:, None])
        found.append(np.array([contact.x_m, contact.y_m, contact.force_n])[:outputs] * CONTACT_UNIT)
        deviation.append(np.sqrt(np.diagonal(contact.covariance))[:outputs] * CONTACT_UNIT)
        in_range.append(not contact.over_range)
    press = labelled.press[:, :outputs]
    return Evaluation(press, np.array(found), np.array(deviation), np.array(in_range), model.hash)
