"""What shear can be told, by place: the deviations that one frame allows, the condition, and the model's own errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmfts.bench.workspace import NOISE_T, Array, standard_pad
from fmfts.calibrate.evaluation import rounded
from fmfts.calibrate.samples import Samples
from fmfts.calibrate.simulated import rest_field_of
from fmfts.calibrate.tracked import FrameSolver, Tracked
from fmfts.contact import ContactModel
from fmfts.contact.response import Response

FORCE_N = 2.0
STEP_MM = 2.0
FRICTION = 0.2
FRAMES = 200


def shear(path: str, random: np.random.Generator) -> dict[str, Any]:
    """Maps over one quarter of the pad, x to the right: an even press of FORCE_N. ValueError for another model."""
    from fmfts.bench.contact import estimates

    pad = standard_pad()
    model = ContactModel.load(path, pad, refine=True)
    if not model.has_shear or model.refiner is None:
        raise ValueError(f"{path} tells no shear: make one with `fmfts-daemon calibrate --shear`")
    response = model.refiner.response
    solver = FrameSolver(pad, rest_field_of(pad), model.facts.scene, NOISE_T)
    axis = np.arange(0.0, response.last_mm[0] + 1e-9, STEP_MM)
    maps: dict[str, list[list[float]]] = {"bound_n": [], "condition": [], "rms_n": [], "refused": []}
    for y_mm in axis:
        row: dict[str, list[float]] = {name: [] for name in maps}
        for x_mm in axis:
            press = np.tile([x_mm, y_mm, FORCE_N, FRICTION * FORCE_N, 0.0], (FRAMES, 1))
            expected = Samples.expected(response, solver, press)
            noisy = expected.noisy(1, random)
            found = estimates(model, Tracked(noisy.pose, noisy.covariance, np.zeros(FRAMES), np.zeros(FRAMES)))
            shears = np.array([one.shear_n for one in found])
            row["bound_n"].append(rounded(np.hypot(*expected.bound[0, 3:]) / np.sqrt(2.0)))
            row["condition"].append(rounded(_condition(response, press[:1])))
            row["rms_n"].append(rounded(np.sqrt(np.mean((shears - press[:, 3:]) ** 2))))
            row["refused"].append(rounded(float(np.mean([one.refused for one in found]))))
        for name, values in row.items():
            maps[name].append(values)
    for name, title in (
        ("bound_n", "least deviation of shear from one frame (N)"),
        ("rms_n", f"rms error of the refined model's shear, {FRICTION * FORCE_N:g} N of it (N)"),
        ("condition", "condition of place, force and shear, in mm and N, from the pose in deviations"),
        ("refused", "share of frames that the model refuses"),
    ):
        print(f"{title}, at {FORCE_N:g} N\n  y\\x " + "".join(f"{x:8g}" for x in axis))
        for y_mm, values in zip(axis, maps[name], strict=True):
            print(f"{y_mm:5g} " + "".join(f"{value:8.3g}" for value in values))
    return {"force_n": FORCE_N, "places_mm": axis.tolist()} | maps


def _condition(response: Response, press: Array) -> float:
    """Of the slope, each component of the pose in the deviation that it has at rest."""
    pad = standard_pad()
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    _, slope = response.change_and_slope(press)
    at_rest = solver.at(solver.rest_pose[None]).deviation[0]
    return float(np.linalg.cond(slope[0] / at_rest[:, None]))
