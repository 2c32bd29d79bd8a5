"""The contact's error with each kind of chip over its Cramér–Rao bound: noise, steps and all, through the solver.

Exact fields of presses become counts of the chip (noise, steps, saturation) and a field again; the solver finds the
pose, and the pad's response the press. The bound of each press: (SᵀP⁻¹S)⁻¹, with P the covariance of its true pose.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import msgspec
import numpy as np

from fmfts.calibrate.likelihood import invert
from fmfts.calibrate.simulated import magnet_fields
from fmfts.calibrate.tracked import FrameSolver, upright
from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load
from fmfts.contact import ContactModel
from fmfts.contact.response import CHANGE, Response
from fmfts.pad import Array
from fmfts.scene import Surroundings
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS
from fmfts.simulation.chip import as_counts
from fmfts_lab.study.scene_chips import Setting, settings
from fmfts_lab.study.scene_facts import recommended_range_gauss

LEAST_N = 0.5  # of a lighter press the noisiest chips tell little more than that it is one


def run(options: Namespace) -> None:
    random = np.random.default_rng(options.seed)
    config = load(EXAMPLE_PATH)[0].pad[0]
    response = ContactModel.load("default", config.pad()).response
    assert response is not None, "the shipped model holds one"
    print(f"{'chip':10} {'trigger':13} {'rate, Hz':>9} {'error over its bound: x':>25} {'y':>6} {'force':>6}")
    for chip in CHIPS.values():
        if chip.streamed:
            continue
        with_chip = msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, chip=chip.name))
        range_gauss = recommended_range_gauss(Surroundings(with_chip, response))
        for setting in settings(chip, len(config.geometry.sensors_mm), range_gauss):
            ratios = error_over_bound(with_chip, response, setting, options.frames, random)
            print(
                f"{chip.label:10} {setting.trigger:13} {setting.rate_hz:9} {ratios[0]:25.3f} {ratios[1]:6.3f} "
                f"{ratios[2]:6.3f}"
            )


def error_over_bound(
    config: object, response: Response, setting: Setting, frames: int, random: np.random.Generator
) -> Array:
    """(3,) rms of the errors of x, y and force, each over its own bound."""
    pad = config.pad()  # type: ignore[attr-defined]
    rest_field = magnet_fields(pad, np.zeros((1, 3)), pad.rest_axis[None])[0]
    solver = FrameSolver(replace(pad), rest_field, "drifting", setting.noise_t)
    press = np.column_stack(
        [random.uniform(-8.0, 8.0, (frames, 2)), random.uniform(LEAST_N, 0.9 * response.scale_n, frames)]
    )
    change, slope = response.change_and_slope(press)
    pose = upright(np.column_stack([solver.rest_pose[:CHANGE] + change, np.zeros(frames)]))
    field = magnet_fields(pad, pose[:, :3] * 1e-3 - pad.rest_position_m, pose[:, 3:])
    tracked = solver.solved(_measured(field, setting, random))
    found = invert(response, tracked.pose[:, :CHANGE] - solver.rest_pose[:CHANGE], tracked.covariance, across=3)
    weight = np.linalg.inv(solver.at(pose).covariance)
    bound = np.linalg.inv(slope[:, :, :3].transpose(0, 2, 1) @ weight @ slope[:, :, :3])
    deviation = np.sqrt(np.einsum("kii->ki", bound))
    ratios: Array = np.sqrt(np.mean(((found[:, :3] - press) / deviation) ** 2, axis=0))
    return ratios


def _measured(field_t: Array, setting: Setting, random: np.random.Generator) -> Array:
    """What the chips say of a field, in tesla again."""
    chip = setting.chip
    assert setting.range_gauss is not None, f"no range of the {chip.label} holds this pad's field"
    code = chip.gain_code_for_range(setting.range_gauss)
    noisy = field_t + random.normal(0.0, chip.noise_at_t(setting.rate_hz, setting.trigger), field_t.shape)
    counts = as_counts(chip, noisy * (np.array(chip.counts_per_gauss[code]) / TESLA_PER_GAUSS))
    assert not (counts == chip.saturated_count).any()
    measured: Array = counts * chip.step_t[code]
    return measured
