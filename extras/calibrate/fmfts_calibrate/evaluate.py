"""`fmfts-daemon evaluate`: compares a contact model's answers with the labels of a test set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.contact import ContactModel
from fmfts.contact.model import CONTACT_UNIT, POSE_UNIT
from fmfts.pad import Array
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import CalibrationSet
from fmfts_calibrate.evaluation import Row, rows
from fmfts_calibrate.labelled_poses import solved, solver_of
from fmfts_calibrate.tracked import Scene, Tracked


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Labels and answers, in mm and N.

    press (K, m): the labels. found (K, m), deviation (K, m): the model's answers and their standard deviations.
    in_range (K,): whether the model answered, with neither "over range" nor a refusal; only these can be compared.
    """

    press: Array
    found: Array
    deviation: Array
    in_range: NDArray[np.bool_]
    model: str
    refine: bool = False
    friction: float = 0.0

    def rows(self) -> list[Row]:
        """Errors of the presses in range, by region."""
        return rows(self.press[self.in_range], self.found[self.in_range], self.deviation[self.in_range])

    def facts(self) -> dict[str, Any]:
        return {
            "model": self.model,
            "refine": self.refine,
            "friction": self.friction,
            "presses": len(self.press),
            "over_range": int((~self.in_range).sum()),
            "regions": self.rows() if self.in_range.any() else [],
        }


def evaluate(
    labelled: CalibrationSet, source: Path, model: ContactModel, scene: Scene, noise_t: float = NOISE_T
) -> Evaluation:
    """Evaluate `model` on the rows of `labelled`, each as a single frame. source: its file, for error texts.

    Raises DataError for a field that no magnet of this pad explains.
    """
    return judge(labelled, solved(str(source), labelled, solver_of(labelled, scene, noise_t)), model)


def judge(labelled: CalibrationSet, tracked: Tracked, model: ContactModel) -> Evaluation:
    """Evaluate `model` on poses that are solved already."""
    answered = 5 if model.has_shear else 3  # a model with shear gives none where the configuration excludes it
    outputs, unit = min(answered, labelled.press.shape[1]), CONTACT_UNIT[:answered]
    found, deviation, in_range = [], [], []
    for pose, covariance in zip(tracked.pose, tracked.covariance, strict=True):
        whole = np.zeros((6, 6))
        whole[:5, :5] = covariance
        position_m, axis = np.split(pose / POSE_UNIT, 2)
        contact = model.estimate(position_m, axis, whole / POSE_UNIT / POSE_UNIT[:, None])
        shear_n = () if contact.shear_n is None else contact.shear_n
        found.append((np.array([contact.x_m, contact.y_m, contact.force_n, *shear_n]) / unit)[:outputs])
        deviation.append((contact.deviations / unit)[:outputs])
        in_range.append(not (contact.over_range or contact.refused))
    press = labelled.press[:, :outputs]
    return Evaluation(
        press, np.array(found), np.array(deviation), np.array(in_range), model.hash, model.refines, model.friction
    )
