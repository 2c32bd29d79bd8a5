"""Chooses the unknowns of a pad's tracker from its scene in the config: the smallest set that the scene allows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.config import MagnetConfig, PadConfig, SceneConfig
from fmfts.pad import Pad
from fmfts.pose import (
    AMBIENT,
    AXIS,
    LOG_MOMENT,
    PAPER,
    POSITION,
    SIZE,
    Part,
    Prior,
    State,
    Status,
    TrackingModel,
    dipole_field,
    parts_of,
    solve,
)
from fmfts.sensor.chips import CHIPS, DEFAULT_CHIP, Chip

# Random walk of the ambient field: twice what a hand that turns at 1 rad/s in the Earth's half gauss causes (2 mG from
# frame to frame).
AMBIENT_WALK_T2_PER_S = square(5e-7) * 220.0
# Error of the subtracted ambient field right after a baseline.
AMBIENT_DEVIATION_T = 1e-6
# Changes of a magnet's moment by ageing and by hysteresis of warming, 0.1 % in an hour.
MOMENT_DEVIATION = 5e-4
MOMENT_WALK_PER_S = square(1e-3) / 3600.0
# Warming of a board without a thermometer, and the time that it takes.
UNSEEN_WARMING_K, UNSEEN_WARMING_S = 3.0, 600.0
# Warming of a board from start to steady state, for a thermometer not read yet, or not at the baseline.
UNREAD_WARMING_K = 20.0
# How much hotter than its board a magnet beside a hot motor may be.
HOTTER_K = 10.0
# Relative uncertainty of the temperature coefficient of a grade of magnet.
COEFFICIENT_SHARE = 0.2
# Largest acceptable deviation of the position: five of them in height are the effect of 0.28 N, the paper's lightest
# press, on the standard pad.
UNCERTAIN_M = 6e-5


@dataclass(frozen=True, slots=True)
class SceneModel:
    """A tracking model, and a sentence for the log that says what was chosen and why."""

    tracking: TrackingModel
    why: str


def tracking_model_for(scene: SceneConfig, magnet: MagnetConfig, chip: Chip = DEFAULT_CHIP) -> SceneModel:
    """The tracking model with the smallest set of unknowns that the scene allows.

    Moment and ambient field are never both estimated: at rest, one combination of height, moment and vertical field is
    not observable, and a filter would invent it. Where the field drifts, the moment is the baseline's, and its error is
    included in the deviations. The field's gradient is not estimated either: carried from frame to frame it turns a
    press into a tilt (700 µm in simulation, with a claimed deviation of 90); it only distinguishes steel from a broken
    sensor. Where the field is constant, each frame determines the moment. Holding it would make contacts an eighth more
    certain (0.84 instead of 0.95 mm at 0.28 N) for an hour, until it may have aged by 0.1 %, and less certain later.
    """
    if scene.ambient == "constant" and not scene.steel_nearby:
        why = "6 unknowns (pose, moment): the ambient field is constant, as the baseline saw it"
        return SceneModel(replace(PAPER, offset_t_per_k=chip.offset_t_per_k), why)
    initial, walk = np.zeros(SIZE), np.zeros(SIZE)
    initial[AMBIENT], walk[AMBIENT] = square(AMBIENT_DEVIATION_T), AMBIENT_WALK_T2_PER_S
    initial[LOG_MOMENT], walk[LOG_MOMENT] = square(MOMENT_DEVIATION), MOMENT_WALK_PER_S
    parts = parts_of(free=np.r_[POSITION, AXIS], considered=LOG_MOMENT, prior=AMBIENT)
    per_k = magnet.temperature_coefficient_per_k
    if chip.thermometer is None:
        walk[LOG_MOMENT] += square(per_k * UNSEEN_WARMING_K) / UNSEEN_WARMING_S
    cause = "steel moves nearby" if scene.steel_nearby else "the field drifts"
    why = f"8 unknowns (pose, ambient field): {cause}, so the moment is the baseline's and follows the temperature"
    if scene.remanence == "drifting":
        initial[LOG_MOMENT] += square(per_k * HOTTER_K)
        why += f"; {abs(per_k) * HOTTER_K:.1%} of it count as unknown, because the ambient field hides its drift"
    unread_k = 0.0 if chip.thermometer is None else UNREAD_WARMING_K
    turns = scene.ambient != "constant"
    tracking = TrackingModel(
        *(parts, initial, walk, per_k, abs(per_k) * COEFFICIENT_SHARE, unread_k, turns),
        chip.offset_t_per_k,
        scene.steel_nearby,
    )
    return SceneModel(tracking, why)


def scene_model_of(config: PadConfig) -> SceneModel:
    """The tracking model that a pad's configuration asks for."""
    return tracking_model_for(config.scene, config.magnet, CHIPS[config.source.chip])


def observability_warnings(pad: Pad, tracking: TrackingModel) -> list[str]:
    """Warnings about what this layout of sensors cannot observe of a magnet at rest with these unknowns."""
    rest, parts = State.at_rest(pad), np.where(tracking.parts == Part.PRIOR, Part.FREE, tracking.parts).astype(np.uint8)
    field = dipole_field(pad.sensors.position_m, rest.position_m, rest.axis, pad.magnet.strength_t_m3)
    estimate = solve(
        pad.sensors.to_sensor(field),
        pad,
        rest,
        deviation_t=pad.chip.noise_t,
        parts=parts,
        prior=Prior(rest, np.diag(tracking.initial)),
    )
    advice = "place the sensors around the magnet, about as far from its axis as it is above them"
    if estimate.status is not Status.CONVERGED:
        names = ", ".join(estimate.unobservable)
        return [f"these sensors cannot tell {names} of a resting magnet apart: every frame will be lost; {advice}"]
    deviation = np.sqrt(np.diagonal(estimate.covariance)[POSITION])
    return [
        f"the {name} of a resting magnet is known to {sd_m * 1e3:.2g} mm only, from one frame: {advice}"
        for name, sd_m in zip(("x", "y", "height"), deviation.tolist(), strict=True)
        if sd_m > UNCERTAIN_M
    ]
