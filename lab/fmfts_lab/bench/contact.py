"""Errors of the contact model on new presses of the simulated pad, and of maximum likelihood on the same frames."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Callable
from typing import Any

import numpy as np

from fmfts.contact import ContactModel
from fmfts.contact.contract import SHEAR_OUTPUT_ORDER
from fmfts.contact.response import Response
from fmfts.contact.shipped import path_of
from fmfts.pad import Pad
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.evaluation import rms, rounded
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.tracked import FrameSolver, Scene, Tracked
from fmfts_lab.bench import contact_live, contact_shear, contact_sizes
from fmfts_lab.bench.contact_answers import answers
from fmfts_lab.bench.workspace import Array, standard_pad
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of

PARTS = ("accuracy", "touch", "motion", "squeezes", "speed", "friction", "shear", "sizes")
SCENES: tuple[Scene, ...] = ("drifting", "constant")
SPEED_RUNS = 3000
PLACE_MM, LIGHTEST_N, FIRMEST_N = 14.0, 0.28, 1.98
CENTRE_MM, RELIABLE_MM = 8.0, 11.0
REFINING_STEPS = 20  # start from the true press, so that only the table's own error remains
REMANENCES_T = (0.6, 0.9, 1.23, 1.28, 1.5)
HEADER = "                                              x (mm)   y (mm)    F (N)"


def drawn_presses(count: int, random: np.random.Generator) -> Array:
    """(K, 3) x and y uniform over the pad, force uniform from the paper's lightest to its firmest."""
    place = random.uniform(-PLACE_MM, PLACE_MM, (count, 2))
    return np.column_stack([place, random.uniform(LIGHTEST_N, FIRMEST_N, count)])


def run(options: Namespace) -> None:
    random = np.random.default_rng(options.seed)
    plain = ContactModel.load(options.model, standard_pad())
    file = path_of(options.model)
    print(f"model {plain.hash}, {file.stat().st_size} bytes")
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "accuracy": lambda: accuracy(options.model, options.frames, random),
        "touch": lambda: contact_live.touch(options.hours, random),
        "motion": lambda: contact_live.motion(plain, random),
        "squeezes": lambda: contact_live.squeezes(plain, random),
        "speed": lambda: speed(options.model),
        "friction": lambda: contact_shear.friction(options.model, random),
    }
    if plain.facts.outputs == SHEAR_OUTPUT_ORDER:
        parts = {"shear": lambda: contact_shear.shear(options.model, random), "speed": parts["speed"]}
    if options.part == "sizes":  # only on request: it trains eight networks three times
        parts = {"sizes": contact_sizes.sizes}
    facts = {name: part() for name, part in parts.items() if options.part in (None, name)}
    if options.out is not None:
        options.out.write_text(json.dumps({"model": plain.hash} | facts, indent=1) + "\n")


def speed(path: str) -> dict[str, Any]:
    """Processor time of an inference, and the additional time of refine."""
    pad = standard_pad()
    models = {name: ContactModel.load(path, pad, refine=name == "refined") for name in ("network", "refined")}
    facts: dict[str, Any] = {}
    for name, model in models.items():
        begun = time.process_time()
        for _ in range(SPEED_RUNS):
            model.estimate(pad.rest_position_m - [0.0, 0.0, 1e-3], pad.rest_axis, np.eye(6) * 1e-10)
        facts[f"{name}_us"] = rounded((time.process_time() - begun) / SPEED_RUNS * 1e6)
    begun = time.process_time()
    for _ in range(SPEED_RUNS):
        models["network"].inference.run()
    facts["inference_us"] = rounded((time.process_time() - begun) / SPEED_RUNS * 1e6)
    print("µs of processor time: " + ", ".join(f"{name[:-3]} {value:.1f}" for name, value in facts.items()))
    return facts


def accuracy(path: str, frames: int, random: np.random.Generator) -> dict[str, Any]:
    """Errors without noise, beside maximum likelihood at 2 mG in both scenes, and for magnets of any remanence."""
    pad = standard_pad()
    plain, refining = (ContactModel.load(path, pad, refine=refine) for refine in (False, True))
    assert refining.refiner is not None
    press = drawn_presses(frames, random)
    noise = random.normal(0.0, NOISE_T, (frames, len(pad.sensors), 3))
    print(f"{frames} presses, x and y in ±14 mm, {LIGHTEST_N} to {FIRMEST_N} N\n{HEADER}")
    facts: dict[str, Any] = {"frames": frames, "noise_free": _noise_free(pad, press, plain, refining.refiner.response)}
    for scene in SCENES:
        solver = FrameSolver(pad, rest_field_of(pad), scene, NOISE_T)
        tracked = solver.solved(pressed_fields(pad, press) + noise)
        facts[scene] = _beside_likelihood(press, solver, tracked, plain, refining)
    return facts | {"remanences": _remanences(pad, press, noise, plain)}


def _noise_free(pad: Pad, press: Array, model: ContactModel, response: Response) -> dict[str, list[float]]:
    solver = FrameSolver(pad, rest_field_of(pad), model.facts.scene, NOISE_T)
    tracked = solver.solved(pressed_fields(pad, press))
    change = tracked.pose[:, :5] - solver.rest_pose[:5]
    table = invert(response, change, tracked.covariance)
    network = answers(model, tracked).found
    between = np.abs(press[:, :2]).max(axis=1) <= RELIABLE_MM
    inside = np.hypot(press[:, 0], press[:, 1]) <= CENTRE_MM
    print("noise-free, mean absolute errors")
    return {
        "table": _row("table inversion", np.abs(table - press).mean(axis=0)),
        "table_largest": _row("table inversion, the largest", np.abs(table - press).max(axis=0)),
        "table_largest_inside": _row("the largest within ±11 mm", np.abs(table - press)[between].max(axis=0)),
        "network": _row("network", np.abs(network - press).mean(axis=0)),
        "network_centre": _row("network within 8 mm", np.abs(network - press)[inside].mean(axis=0)),
    }


def _beside_likelihood(
    press: Array, solver: FrameSolver, tracked: Tracked, plain: ContactModel, refining: ContactModel
) -> dict[str, list[float]]:
    assert refining.refiner is not None
    change = tracked.pose[:, :5] - solver.rest_pose[:5]
    best = np.abs(invert(refining.refiner.response, change, tracked.covariance) - press)
    inside = np.hypot(press[:, 0], press[:, 1]) <= RELIABLE_MM
    print(f"2 mG, single frames, scene {solver.scene}")
    facts = {"maximum_likelihood": _row("maximum likelihood, mean absolute error", best.mean(axis=0))}
    for name, model in (("network", plain), ("refined", refining)):
        found = answers(model, tracked)
        error = found.found - press
        share = np.abs(error).mean(axis=0) / best.mean(axis=0)
        facts[f"{name}_over_best"] = _row(f"{name} over maximum likelihood", share)
        for where, members in (("within 11 mm", inside), ("beyond", ~inside)):
            in_sd = [rms(error[members, column] / found.deviation[members, column]) for column in range(3)]
            facts[f"{name}_in_sd_{where}"] = _row(f"{name}, errors in deviations, {where}", np.array(in_sd))
    return facts


def _remanences(pad: Pad, press: Array, noise: Array, model: ContactModel) -> dict[str, list[float]]:
    """Error × remanence divided by that at 1.23 T, with the same presses and noise for every magnet."""
    scene: Scene = model.facts.scene
    errors = {}
    for remanence_t in REMANENCES_T:
        magnet = pad.magnet.with_remanence(remanence_t)
        solver = FrameSolver(pad, rest_field_of(pad, magnet), scene, NOISE_T)
        found = answers(model, solver.solved(pressed_fields(pad, press, magnet) + noise)).found
        errors[remanence_t] = np.abs(found - press)
    radius = np.hypot(press[:, 0], press[:, 1])
    facts = {}
    for where, members in (("", radius >= 0.0), (", within 11 mm", radius <= RELIABLE_MM)):
        print(f"error × remanence at 2 mG, over that at 1.23 T{where}")
        mean = {remanence_t: error[members].mean(axis=0) for remanence_t, error in errors.items()}
        for remanence_t, error in mean.items():
            share = error * remanence_t / mean[1.23] / 1.23
            facts[f"{remanence_t} T{where}"] = _row(f"magnet of {remanence_t} T", share)
        facts[f"error 1.28 T{where}"] = _row("error at 1.28 T over that at 1.23 T", mean[1.28] / mean[1.23])
    return facts


def _row(name: str, values: Array) -> list[float]:
    print(f"  {name:42}" + "".join(f"{value:9.4f}" for value in values))
    return [rounded(value) for value in values]
