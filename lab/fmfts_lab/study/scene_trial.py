"""Tries a model on its scene, beyond first order: solves exact fields with noise and takes the most likely press. Pads
side by side run with the whole pipeline."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact.response import CHANGE
from fmfts.pad import Array, Pad
from fmfts.pose import STOP_CONVERGED, dipole_field, solve
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.samples import presses_within
from fmfts_calibrate.tracked import FrameSolver, Tracked, UnsolvedError, upright
from fmfts_lab.bench.neighbours import Outcome, pressed_pair
from fmfts_lab.calibration.simulated import magnet_fields
from fmfts_lab.scene import AMBIENT_CHANGE_T, Model, Surroundings

TURNING_DEG_PER_S = 20.0  # the robot's turn, if the ambient field drifts
LIGHTEST_SHARE = 0.15  # share of full scale; under lighter presses the place is very uncertain


def tried(surroundings: Surroundings, model: Model, frames: int, seed: int) -> Array:
    """(K, 3) errors of x, y in mm and force in N, of up to `frames` presses within 8 mm, from light to full scale.

    Since the baseline the magnet has aged, in a constant scene, or the ambient field has turned, in a drifting one.
    Neighbours are at rest; `tried_beside` shows their effect on a running pad.
    """
    random, pad = np.random.default_rng(seed), surroundings.config.pad()
    modelled = replace(pad, magnet=replace(pad.magnet, as_cylinder=model.cylinder))
    rest_field = magnet_fields(pad, np.zeros((1, 3)), pad.rest_axis[None])[0]
    solver = FrameSolver(modelled, rest_field, "constant" if model.unknowns == 6 else "drifting", surroundings.noise_t)
    press = presses_within(surroundings.response, frames, random, beyond=1.0)
    press = press[press[:, 2] >= LIGHTEST_SHARE * surroundings.response.scale_n]
    press = press[np.abs(press[:, :2]).max(axis=1) <= 8.0]
    field = _fields(pad, solver, surroundings, press)
    if surroundings.drifts:
        ambient = np.repeat(random.normal(0.0, AMBIENT_CHANGE_T, (len(press), 1, 3)), len(pad.sensors), axis=1)
        field += pad.sensors.to_sensor(ambient)
    # The baseline subtracted the part of the unloaded field that the model does not explain.
    unexplained = rest_field - _modelled_rest_field(modelled, rest_field)
    field += random.normal(0.0, surroundings.noise_t, field.shape) - unexplained
    press, tracked = _solved(solver, press, field)
    found = invert(
        surroundings.response, tracked.pose[:, :CHANGE] - solver.rest_pose[:CHANGE], tracked.covariance, across=3
    )
    errors: Array = found[:, :3] - press[:, :3]
    return errors


class Beside(NamedTuple):
    """errors (K, 3) of x, y in mm and force in N, for the presses that both runs (told and not told) answered.
    answered: the share of all presses."""

    outcome: Outcome
    errors: Array
    answered: float


def tried_beside(surroundings: Surroundings, seconds: float, seed: int) -> tuple[Beside, Beside]:
    """Runs the whole pipeline on two simulated pads, this one and the nearest other, each pressed by its own finger:
    once with knowledge of the other's magnet (told), and once without.

    ModelError if a config's model is not for its pad, BaselineError if the pads are too near for a baseline.
    """
    here, there = surroundings.config, surroundings.others[0]
    pads = _simulated(here, there, seed), _simulated(there, here, seed + 1000)
    outcomes = [pressed_pair(pads, told, seconds) for told in (True, False)]
    answers = np.array([outcome.answers for outcome in outcomes])
    pressing = answers[0, :, 3] >= LIGHTEST_SHARE * surroundings.response.scale_n
    answers = answers[:, pressing, :3]
    answered = np.isfinite(answers).all(axis=2)
    told, untold = (
        Beside(outcome, each[answered.all(axis=0)], float(mine.mean()))
        for outcome, each, mine in zip(outcomes, answers, answered, strict=True)
    )
    return told, untold


def _simulated(config: PadConfig, beside: PadConfig, seed: int) -> PadConfig:
    turning = TURNING_DEG_PER_S if config.scene.ambient == "drifting" else 0.0
    source = SimulatedSource(seed=seed, range_gauss=config.source.range_gauss, finger="none", turning_deg_per_s=turning)
    scene = msgspec.structs.replace(config.scene, neighbours=(beside.name,))
    return msgspec.structs.replace(config, source=source, scene=scene)


def _solved(solver: FrameSolver, press: Array, field: Array) -> tuple[Array, Tracked]:
    """The presses for which the solver finds a pose; with an unsuitable model these are not all."""
    while True:
        try:
            return press, solver.solved(field)
        except UnsolvedError as error:
            press, field = np.delete(press, error.row, axis=0), np.delete(field, error.row, axis=0)


def _modelled_rest_field(pad: Pad, rest_field: Array) -> Array:
    rest, magnet = solve(rest_field, pad, stop_chi2=STOP_CONVERGED), pad.magnet
    field = dipole_field(
        pad.sensors.position_m,
        rest.position_m,
        rest.axis,
        magnet.with_remanence(rest.remanence_t).strength_t_m3,
        magnet.modelled_octupole_m2,
    )
    return pad.sensors.to_sensor(field)


def _fields(pad: Pad, solver: FrameSolver, surroundings: Surroundings, press: Array) -> Array:
    change = surroundings.response.change(press)
    pose = upright(np.column_stack([solver.rest_pose[:CHANGE] + change, np.zeros(len(press))]))
    aged = 1.0 if surroundings.drifts else 1.0 + surroundings.moment_deviation
    magnet = pad.magnet.with_remanence(pad.magnet.remanence_t * aged)
    return magnet_fields(pad, pose[:, :3] * 1e-3 - pad.rest_position_m, pose[:, 3:], magnet)
