"""The contact's error with each kind of chip over its Cramér–Rao bound: noise, steps and all, through the solver.

Exact fields of presses become counts of the chip (noise, steps, saturation) and a field again; the solver finds the
pose, and the pad's response the press. The bound of each press: (SᵀP⁻¹S)⁻¹, with P the covariance of its true pose.

Force is curved: where the noise is a third of it, the most likely force is too large in the mean. The last columns
take that mean away (curvature.py), and show by how much the bound itself grows with curvature.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load
from fmfts.contact import ContactModel
from fmfts.contact.response import CHANGE, Response
from fmfts.pad import Array
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.tracked import FrameSolver, upright
from fmfts_lab.bench.curvature import Curvature, curvature, weight_with_free_ambient
from fmfts_lab.calibration.simulated import magnet_fields
from fmfts_lab.scene import Surroundings
from fmfts_lab.study.scene_chips import Setting, settings
from fmfts_lab.study.scene_facts import recommended_range_gauss
from fmfts_simulation.chip import as_counts

LEAST_N = 0.5  # from a lighter press the noisiest chips learn little more than that there is one
FAINTEST_N = 0.1
STEPS = (0.03, 0.03, 0.003)  # mm, mm, N: bounds of differences


def run(options: Namespace) -> None:
    random = np.random.default_rng(options.seed)
    config = load(EXAMPLE_PATH)[0].pad[0]
    response = ContactModel.load("default", config.pad()).response
    assert response is not None, "the shipped model holds one"
    print(
        f"{'chip':10} {'trigger':13} {'rate, Hz':>9} {'error over its bound: x':>25} {'y':>6} {'force':>6} "
        f"{'mean':>7} {'force without it':>17} {'curved bound':>13}"
    )
    for chip in CHIPS.values():
        if chip.streamed:
            continue
        with_chip = msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, chip=chip.name))
        range_gauss = recommended_range_gauss(Surroundings(with_chip, response))
        for setting in settings(chip, len(config.geometry.sensors_mm), range_gauss):
            one = error_over_bound(with_chip, response, setting, options.frames, random)
            print(
                f"{chip.label:10} {setting.trigger:13} {setting.rate_hz:9} {one.ratios[0]:25.3f} {one.ratios[1]:6.3f} "
                f"{one.ratios[2]:6.3f} {one.mean_force:7.3f} {one.straightened:17.3f} {one.curved_bound:13.3f}",
                flush=True,
            )


@dataclass(frozen=True)
class OverBound:
    """All over the linear bound. ratios (3,): rms errors of x, y and force. mean_force: mean error of force.
    straightened: rms error of force less its bias by curvature. curved_bound: the least one with curvature counted."""

    ratios: Array
    mean_force: float
    straightened: float
    curved_bound: float


def error_over_bound(
    config: object, response: Response, setting: Setting, frames: int, random: np.random.Generator
) -> OverBound:
    """The error of each press, divided by its own bound."""
    pad = config.pad()  # type: ignore[attr-defined]
    rest_field = magnet_fields(pad, np.zeros((1, 3)), pad.rest_axis[None])[0]
    solver = FrameSolver(replace(pad), rest_field, "drifting", setting.noise_t)
    press = np.column_stack(
        [random.uniform(-8.0, 8.0, (frames, 2)), random.uniform(LEAST_N, 0.9 * response.scale_n, frames)]
    )

    def pose_of(press: Array) -> Array:
        change = response.change(press)
        return upright(np.column_stack([solver.rest_pose[:CHANGE] + change, np.zeros(len(press))]))

    def field_of(press: Array) -> Array:
        pose = pose_of(press)
        return magnet_fields(pad, pose[:, :3] * 1e-3 - pad.rest_position_m, pose[:, 3:])

    _, slope = response.change_and_slope(press)
    tracked = solver.solved(_measured(field_of(press), setting, random))
    found = invert(response, tracked.pose[:, :CHANGE] - solver.rest_pose[:CHANGE], tracked.covariance, across=3)
    weight = np.linalg.inv(solver.at(pose_of(press)).covariance)
    bound = np.linalg.inv(slope[:, :, :3].transpose(0, 2, 1) @ weight @ slope[:, :, :3])
    deviation = np.sqrt(np.einsum("kii->ki", bound))
    error = (found[:, :3] - press) / deviation

    def curved(press: Array) -> Curvature:
        free = weight_with_free_ambient(setting.noise_t, len(pad.sensors))
        return curvature(lambda at: field_of(at).reshape(len(at), -1), press, STEPS, free)

    # The bias of the detected press, which is all that a pad knows; for the faintest presses it is useless.
    bias = curved(np.maximum(found[:, :3], (-np.inf, -np.inf, FAINTEST_N))).bias[:, 2]
    straightened = found[:, 2] - np.minimum(bias, found[:, 2] / 2.0) - press[:, 2]
    return OverBound(
        np.sqrt(np.mean(error**2, axis=0)),
        float(error[:, 2].mean()),
        _rms(straightened / deviation[:, 2]),
        _rms(np.sqrt(curved(press).bound[:, 2, 2]) / deviation[:, 2]),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _measured(field_t: Array, setting: Setting, random: np.random.Generator) -> Array:
    """A field after the chips' noise, steps and saturation, in tesla again."""
    chip = setting.chip
    assert setting.range_gauss is not None, f"no range of the {chip.label} holds this pad's field"
    code = chip.gain_code_for_range(setting.range_gauss)
    noisy = field_t + random.normal(0.0, chip.noise_at_t(setting.rate_hz, setting.trigger), field_t.shape)
    counts = as_counts(chip, noisy * (np.array(chip.counts_per_gauss[code]) / TESLA_PER_GAUSS))
    assert not (counts == chip.saturated_count).any()
    measured: Array = counts * chip.step_t[code]
    return measured
