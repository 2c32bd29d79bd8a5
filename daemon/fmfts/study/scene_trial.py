"""A model on its scene, not to first order: exact fields with noise, solved, and the most likely press taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.calibrate.likelihood import invert
from fmfts.calibrate.samples import presses_within
from fmfts.calibrate.simulated import magnet_fields
from fmfts.calibrate.tracked import FrameSolver, Tracked, UnsolvedError, upright
from fmfts.contact.response import CHANGE
from fmfts.needs import AMBIENT_CHANGE_T, Model, Surroundings
from fmfts.pad import Array, Pad
from fmfts.pose import STOP_CONVERGED, dipole_field, solve


def tried(around: Surroundings, model: Model, frames: int, seed: int) -> Array:
    """(K, 3) errors of x, y in mm and force in N, of up to `frames` presses within 8 mm, from light to full scale.

    The magnet has aged since the baseline, where a running model could tell; a field that drifts has turned. Neighbours
    rest: what they do to a running pad, `python -m fmfts.bench neighbours` shows.
    """
    random, pad = np.random.default_rng(seed), around.config.pad()
    modelled = replace(pad, magnet=replace(pad.magnet, as_cylinder=model.cylinder))
    rest_field = magnet_fields(pad, np.zeros((1, 3)), pad.rest_axis[None])[0]
    solver = FrameSolver(modelled, rest_field, "constant" if model.unknowns == 6 else "drifting", around.noise_t)
    press = presses_within(around.response, frames, random, beyond=1.0)
    press = press[press[:, 2] >= 0.15 * around.response.scale_n]
    press = press[np.abs(press[:, :2]).max(axis=1) <= 8.0]
    field = _fields(pad, solver, around, press)
    if around.drifts:
        ambient = np.repeat(random.normal(0.0, AMBIENT_CHANGE_T, (len(press), 1, 3)), len(pad.sensors), axis=1)
        field += pad.sensors.to_sensor(ambient)
    # The baseline took away what the model does not explain of the unloaded field.
    unexplained = rest_field - _modelled_rest_field(modelled, rest_field)
    field += random.normal(0.0, around.noise_t, field.shape) - unexplained
    press, tracked = _solved(solver, press, field)
    found = invert(around.response, tracked.pose[:, :CHANGE] - solver.rest_pose[:CHANGE], tracked.covariance, across=3)
    errors: Array = found[:, :3] - press[:, :3]
    return errors


def _solved(solver: FrameSolver, press: Array, field: Array) -> tuple[Array, Tracked]:
    """Those that the solver finds a pose for, which is not every frame of a model that does not suit the scene."""
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


def _fields(pad: Pad, solver: FrameSolver, around: Surroundings, press: Array) -> Array:
    change = around.response.change(press)
    pose = upright(np.column_stack([solver.rest_pose[:CHANGE] + change, np.zeros(len(press))]))
    aged = 1.0 if around.drifts else 1.0 + around.moment_deviation
    magnet = pad.magnet.with_remanence(pad.magnet.remanence_t * aged)
    return magnet_fields(pad, pose[:, :3] * 1e-3 - pad.rest_position_m, pose[:, 3:], magnet)
