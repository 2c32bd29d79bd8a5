"""Corrects the contact model of a pad with one magnet by a few presses: the smallest correction that explains them.

It compares the change of the magnet's pose, whose five numbers four sensors determine well. C is the covariance through
noise, the baseline, labels and the response itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.contact import ContactModel
from fmfts.contact.array_response import ArrayResponse
from fmfts.contact.contract import OUTPUT_ORDER
from fmfts.contact.inference import NetworkInference
from fmfts.contact.response import CHANGE, Response
from fmfts.contact.seal import hash_of, unsealed
from fmfts.pad import Array, Pad
from fmfts_calibrate.array_correction import Correction
from fmfts_calibrate.correction_fit import Corrected, Predictions, smallest_correction
from fmfts_calibrate.evaluation import metrics
from fmfts_calibrate.export import export, network_of, packed_weights
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.field_units import drawn_field
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.pad_set import PoseSet
from fmfts_calibrate.press_set import Rows
from fmfts_calibrate.reshaped import Reshaped, error_of, sizes_of
from fmfts_calibrate.tracked import FrameSolver

FEWEST_PRESSES = 5
# Deviations of the factors of each kind of movement, and of the width. Thickness acts like stiffness, up to some
# percent (contact/tolerances.py), and few presses on one side would give a wrong ratio of the factors.
KIND, WIDTH = 0.05, 0.04
LEAST_ERROR, LARGEST_ERROR = 0.01, 0.2
SIDEWAYS, DOWN, TILT = [0, 1], [2], [3, 4]  # numbers of a change of pose


@dataclass(frozen=True)
class _Poses(Predictions):
    """Predicts the poses of presses of one set."""

    levels = ("force", "shape", "places")
    labels_by = "shape"
    # The presses' purpose is the scale of forces: it is corrected even if other errors are larger.
    may_stay = False

    data: PoseSet

    @cached_property
    def _of_map(self) -> Array:
        return self.correction.map_at(self.data.press[:, :2], np.zeros((1, 2)))

    def predicted(
        self, theta: Array, rows: Rows, error: float | None, free: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array, Array, Array | None]:
        data = self.data
        change, by_theta, by_press = self.correction.presses(
            theta, data.press[rows], np.zeros((1, 2)), self._of_map[rows]
        )
        slope = by_theta[:, :, np.zeros(len(theta), dtype=np.bool_) if free is None else free]
        residual = data.change[rows] - change
        if error is None:
            return residual, slope, by_press, None
        of_label = by_press * data.press_deviation[rows][:, None]
        covariance = data.covariance[rows] + np.einsum("kip,kjp->kij", of_label, of_label)
        covariance += np.square(error * sizes_of(change))[:, :, None] * np.eye(CHANGE)
        return residual, slope, by_press, np.linalg.cholesky(covariance)


def _errors(poses: _Poses, made: Corrected, whose: str) -> Array:
    """(5,) the response's own errors, relative to the sizes of a movement, from left-out presses: the part that labels,
    noise and the baseline do not explain. DataError if the error of the downward movement is too large."""
    more, size = np.zeros(CHANGE), np.zeros(CHANGE)
    for theta, rows in made.left.folds:
        residual, _, _, root = poses.predicted(theta, rows, 0.0)
        assert root is not None
        more += np.sum(np.square(residual) - np.sum(np.square(root), axis=2), axis=0)
        size += np.sum(np.square(sizes_of(poses.data.change[rows])), axis=0)
    kinds = np.zeros((CHANGE, CHANGE))
    for kind in (SIDEWAYS, DOWN, TILT):
        kinds[np.ix_(kind, kind)] = 1.0
    error: Array = np.maximum(np.sqrt(np.maximum(kinds @ more, 0.0) / (kinds @ size)), LEAST_ERROR)
    if error[DOWN].max() > LARGEST_ERROR:
        raise DataError(
            f"{whose}: no correction of the contact model explains these presses: those left out of its fit are missed "
            f"by {error[DOWN].max():.0%} of what the magnet moves: is it this pad, and its baseline, and are x and y "
            "those of the pad?"
        )
    return error


@dataclass(frozen=True, slots=True)
class CorrectedModel:
    """model: the file. facts: for the report."""

    model: bytes
    facts: dict[str, Any]


@dataclass(frozen=True, slots=True)
class StartingModel:
    """The model to correct. stiffness: of the pad by a known weight, over the model's; 1 without a weight."""

    model: ContactModel
    stiffness: float = 1.0


def correct_model(data: PoseSet, whose: str, start: StartingModel, pad: Pad, scale: float, say: Say) -> CorrectedModel:
    """The contact model of this pad. whose: names the set in errors. scale: common relative error of the labels'
    forces.

    DataError where the presses are too few, a label is wrong, or no correction explains them.
    """
    with threadpool_limits(1):  # gives the same file with any number of cores, and leaves the others free
        return _corrected(data, whose, start, pad, scale, say)


def _corrected(data: PoseSet, whose: str, start: StartingModel, pad: Pad, scale: float, say: Say) -> CorrectedModel:
    model, response = start.model, start.model.response
    if not isinstance(model.inference, NetworkInference) or response is None or model.facts.outputs != OUTPUT_ORDER:
        raise DataError(
            "the contact model cannot be corrected: take a model without shear that `calibrate` wrote, or the shipped "
            'one ([pad.contact] model = "default")'
        )
    if len(data.press) < FEWEST_PRESSES:
        raise DataError(f"{whose}: {len(data.press)} presses; a correction needs {FEWEST_PRESSES}, better 9 or more")
    response = response.without_shear()
    if len(set(response.first_mm)) > 1 or len(set(response.spacing_mm)) > 1:
        raise DataError("the contact model cannot be corrected: its presses were not on a square about the middle")
    table = _as_table(response, start.stiffness)
    poses = _Poses(data, Correction.of(table, np.zeros((1, 2)), KIND, WIDTH))
    made = smallest_correction(poses, whose, say)
    errors = _errors(poses, made, whose)
    say("its own errors, of a movement: sideways {:.1%}, down {:.1%}, tilt {:.1%}".format(*errors[[0, 2, 3]]))
    reshaped = Reshaped.of(made.theta, start.stiffness)
    network = reshaped.network(network_of(np.frombuffer(model.inference.network, np.float32)))
    own = reshaped.response(response)
    facts = reshaped.facts(model.facts)
    solver = FrameSolver(pad, drawn_field(pad), facts.scene, facts.noise_ut * 1e-6)
    pose = np.zeros((len(data.change), CHANGE + 1))
    pose[:, :CHANGE] = solver.rest_pose[:CHANGE] + data.change
    facts = msgspec.structs.replace(
        facts,
        response_error=error_of(own, facts, solver, errors, scale),
        geometry_hash=pad.geometry_hash,
        dimensions=pad.dimensions,
        metrics=metrics(data.press[:, :3], network(pose)),
        data=data.digest,
        made_by="fmfts-daemon calibrate --correct",
    )
    report = _facts(made, reshaped, network(pose), data)
    report |= {"largest_force_n": round(own.scale_n, 3), "errors_of_movement": np.round(errors, 4).tolist()}
    model_file = export(network, facts, own)
    report["model"] = hash_of(unsealed(model_file), packed_weights(network))
    return CorrectedModel(model_file, report)


def _facts(made: Corrected, reshaped: Reshaped, found: Array, data: PoseSet) -> dict[str, Any]:
    share = found[:, 2] / data.press[:, 2] - 1.0
    return {
        "corrections": [level.facts() for level in made.levels],
        "chosen": made.chosen,
        "stiffness": round(reshaped.stiffness, 4),
        "movement_factors": np.round(reshaped.kinds, 4).tolist(),
        "width_factor": round(reshaped.wider, 4),
        "magnet_beside_mm": np.round(reshaped.off_mm, 3).tolist(),
        "force_off_on_these_presses": round(float(np.sqrt(np.mean(np.square(share)))), 4),
    }


def _as_table(response: Response, stiffness: float) -> ArrayResponse:
    """The response to normal forces as a table of presses of one magnet, on silicone that is stiffer by this factor."""
    scale_n = response.scale_n * stiffness
    powers = response.exponent[:, 0]
    terms = int(powers.max())
    shape = (*response.coefficient.shape[:2], terms, CHANGE)
    coefficient = np.zeros(shape)
    for number, power in enumerate(powers.tolist()):
        coefficient[:, :, power - 1] = response.coefficient[:, :, number] / scale_n**power
    shear = np.zeros((*shape[:2], 2, CHANGE))
    first_mm, spacing_mm = float(response.first_mm[0]), float(response.spacing_mm[0])
    return ArrayResponse(first_mm, spacing_mm, scale_n, coefficient, shear, "")
