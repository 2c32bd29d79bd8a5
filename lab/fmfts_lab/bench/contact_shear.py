"""Shear: how well a model with five outputs measures it, by place; and the errors it causes in one with three."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fmfts.contact import ContactModel
from fmfts.contact.response import Response
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import CalibrationSet
from fmfts_calibrate.evaluate import judge
from fmfts_calibrate.evaluation import rms, rounded
from fmfts_calibrate.samples import Samples
from fmfts_calibrate.tracked import FrameSolver, Tracked
from fmfts_lab.bench.contact_answers import answers, estimates
from fmfts_lab.bench.workspace import Array, standard_pad
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of
from fmfts_lab.calibration.solved_set import labelled
from fmfts_simulation.solved_table import SHEARED_PATH, read_solved

FORCE_N = 2.0
STEP_MM = 2.0
FRICTION, SHEAR_FRICTION = 0.2, 0.5  # friction of the maps' finger; the setting for the model that measures shear
FRAMES = 200
SOLVED_TEST, NOISY = SHEARED_PATH.with_name("test_shear.csv"), 20
# Coefficients of friction, of the finger and in the model's settings: each combination is tested with three outputs.
COEFFICIENTS = (0.0, 0.3)
SLIPPING_FRAMES, RELIABLE_MM, LIGHTEST_N, FIRMEST_N = 2000, 11.0, 0.28, 1.98
WRONG_DEVIATIONS = 5.0


def shear(path: str, random: np.random.Generator) -> dict[str, Any]:
    """Maps over one quarter of the pad, x to the right, for an even press of FORCE_N. ValueError without shear."""
    pad = standard_pad()
    model = ContactModel.load(path, pad, friction=SHEAR_FRICTION)
    response = model.response
    if not model.has_shear or response is None:
        raise ValueError(f"{path} tells no shear: make one with `fmfts-daemon calibrate --shear`")
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
        ("rms_n", f"rms error of the model's shear, {FRICTION * FORCE_N:g} N of it (N)"),
        ("condition", "condition of place, force and shear, in mm and N, from the pose in deviations"),
        ("refused", "share of frames that the model refuses"),
    ):
        print(f"{title}, at {FORCE_N:g} N\n  y\\x " + "".join(f"{x:8g}" for x in axis))
        for y_mm, values in zip(axis, maps[name], strict=True):
            print(f"{y_mm:5g} " + "".join(f"{value:8.3g}" for value in values))
    return {"force_n": FORCE_N, "places_mm": axis.tolist(), "solved": solved(path, random)} | maps


def solved(path: str, random: np.random.Generator) -> dict[str, Any]:
    """Errors on presses within ±8 mm that finite elements solved one by one, with shear up to half their force."""
    pad = standard_pad()
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    rows = labelled(read_solved(SOLVED_TEST), pad)
    press, field = rows[:, :5], rows[:, 5:].reshape(len(rows), -1, 3) * 1e-6
    known = CalibrationSet(pad, press, field, tuple(range(len(press))), "none", None)
    many = replace(known, press=np.repeat(press, NOISY, axis=0))
    noisy = np.repeat(field, NOISY, axis=0)
    noisy = noisy + random.normal(0.0, NOISE_T, noisy.shape)
    facts: dict[str, Any] = {}
    print(
        f"{len(press)} directly solved presses: mean errors of x, y (mm), force, shear x, y (N); at 2 mG in deviations"
    )
    model = ContactModel.load(path, pad, friction=SHEAR_FRICTION)
    for frames, judged in (
        ("noise-free", judge(known, solver.solved(field), model)),
        ("2 mG", judge(many, solver.solved(noisy), model)),
    ):
        error = (judged.found - judged.press)[judged.in_range]
        mae = [rounded(value) for value in np.abs(error).mean(axis=0)]
        in_sd = [rms(column) for column in (error / judged.deviation[judged.in_range]).T]
        refused = rounded(1.0 - float(judged.in_range.mean()))
        facts[frames] = {"mae": mae, "in_sd": in_sd, "refused": refused}
        shown = "" if frames == "noise-free" else "  |" + "".join(f"{value:6.2f}" for value in in_sd)
        print(f"  {frames:12}" + "".join(f"{value:8.4f}" for value in mae) + f"{shown}  refused {refused:.1%}")
    return facts


def _condition(response: Response, press: Array) -> float:
    """Condition of the slope, with each component of the pose in its deviation at rest."""
    pad = standard_pad()
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    _, slope = response.change_and_slope(press)
    at_rest = solver.at(solver.rest_pose[None]).deviation[0]
    return float(np.linalg.cond(slope[0] / at_rest[:, None]))


def friction(path: str, random: np.random.Generator) -> dict[str, Any]:
    """Errors of a model with three outputs under shear within the cone of friction, and its published deviations."""
    pad = standard_pad()
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    facts: dict[str, Any] = {}
    print(
        f"2 mG, within {RELIABLE_MM:g} mm, {LIGHTEST_N} to {FIRMEST_N} N, shear anywhere in the cone of the finger's "
        "friction\nfriction of   errors: x, y (mm), F (N)      in the model's deviations   an error beyond 5"
    )
    for of_finger in COEFFICIENTS:
        press = _slipping(of_finger, random)
        field = pressed_fields(pad, press)
        tracked = solver.solved(field + random.normal(0.0, NOISE_T, field.shape))
        for of_model in COEFFICIENTS:
            said = answers(ContactModel.load(path, pad, friction=of_model), tracked)
            error = said.found - press[:, :3]
            share = np.abs(error) / said.deviation
            mae = [rounded(value) for value in np.abs(error).mean(axis=0)]
            in_sd = [rms(share[:, column]) for column in range(3)]
            wrong = rounded(float((share > WRONG_DEVIATIONS).any(axis=1).mean()))
            name = f"finger {of_finger:g}, model {of_model:g}"
            facts[name] = {"mae": mae, "in_sd": in_sd, "wrong": wrong}
            errors, deviations = ("".join(f"{value:9.4f}" for value in row) for row in (mae, in_sd))
            print(f"{name:23}{errors}  {deviations}  {wrong:9.2%}")
    return facts


def _slipping(coefficient: float, random: np.random.Generator) -> Array:
    """(K, 5) presses: places spread over the disc, shear over the cone of friction."""
    radius, angle = RELIABLE_MM * np.sqrt(random.uniform(0, 1, SLIPPING_FRAMES)), _angles(random)
    force_n, towards = random.uniform(LIGHTEST_N, FIRMEST_N, SLIPPING_FRAMES), _angles(random)
    shear_n = coefficient * force_n * np.sqrt(random.uniform(0, 1, SLIPPING_FRAMES))
    return np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), force_n, shear_n * np.cos(towards), shear_n * np.sin(towards)]
    )


def _angles(random: np.random.Generator) -> Array:
    return random.uniform(0.0, 2.0 * np.pi, SLIPPING_FRAMES)
