"""A pressed pad on a robot that turns in the Earth's field: the errors from the drifting field, and from warming."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fmfts.baseline.evenness import INDEPENDENT, STRENGTH_DEVIATION
from fmfts.baseline.sensitivity import Sensitivity, relative_deviation
from fmfts.baseline.turn import ORIENTATIONS, UNEVEN_DEVIATION_T, Turn, sensitivity_from_turn
from fmfts.baseline.window_means import MEAN_OF
from fmfts.config import MagnetConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact._contact import RELEASE_FRAMES
from fmfts.pad import Pad, rotation_from_vector
from fmfts.pipeline.configured import load_contact_model
from fmfts.pose import FREE_FIELD, State, dipole_field, solve
from fmfts.scene.tracking import COEFFICIENT_SHARE, tracking_model_for
from fmfts.sensor.chips import NOISE_T
from fmfts_lab.bench.drills import AS_DRAWN, Ambient
from fmfts_lab.bench.field_tracker import FieldTracker
from fmfts_lab.bench.tapped import pipeline_of
from fmfts_lab.bench.truth import WRONG_DEVIATIONS, Truth
from fmfts_lab.bench.workspace import Array, standard_pad
from fmfts_simulation.finger import Touch
from fmfts_simulation.source import Simulated

EARTH_AT_FIRST_T = 0.5e-4 * np.array([0.6, -0.64, 0.48])
SELFTESTED, UNTESTED = 0.005, 0.05
FRAME_S = 1.0 / 220.0
SETTLE_FRAMES = 110
PRESS_S, PAUSE_S = 1.0, 1.0
# RELEASE_FRAMES quiet frames end a contact (quiet: χ² below the release). By noise alone one frame in 100 is not quiet.
RELEASE_S = 2 * RELEASE_FRAMES * FRAME_S
TURN_FRAMES = 20 * 220  # as many as `baseline --turn` records


def run(options: Namespace) -> None:
    frames = round(options.seconds / FRAME_S)
    print(f"half a gauss through all directions at 1 rad/s, pressed; {frames} frames, white noise of 2 mG;")
    print(f"{options.draws} pads where gains are off")
    print(
        "RMSE over the single-frame bound with eight unknowns: x y z tilt1 tilt2 | all | not ok | NEES of the pose / 5"
    )
    print("errors are of frames that are ok; the band of an honest covariance (95 %) is that of independent frames\n")
    pad, random, draws = standard_pad(), np.random.default_rng(options.seed), range(options.draws)
    perfect = Gains.off_by(pad, 0.0)
    _turned("drifting, perfect gains", "drifting", [perfect], frames, random)
    within = [_within(pad, SELFTESTED, random) for _ in draws]
    _turned("drifting, within ±0.5 %", "drifting", within, frames, random)
    _turned("drifting, sd of 0.5 %", "drifting", [_drawn(pad, SELFTESTED, random) for _ in draws], frames, random)
    _turned("drifting, sd of 5 %", "drifting", [_drawn(pad, UNTESTED, random) for _ in draws], frames, random)
    _turned("the same after --turn", "drifting", [_after_turn(pad, random) for _ in draws], frames, random)
    _turned("constant, perfect gains", "constant", [perfect], frames, random)
    if options.warm_minutes:
        _warm(options.warm_minutes, range(options.seed, options.seed + options.warm_pads))


@dataclass(frozen=True, slots=True)
class Gains:
    """true (N, 3), and the deviation (N, 3) of their errors, which is all that the tracker knows."""

    true: Array
    deviation: Array

    @classmethod
    def off_by(cls, pad: Pad, deviation: float) -> Gains:
        shape = len(pad.sensors), 3
        return cls(np.ones(shape), np.full(shape, deviation))


def _drawn(pad: Pad, deviation: float, random: np.random.Generator) -> Gains:
    """Random gains with this deviation; the tracker knows only the deviation."""
    true = 1.0 + deviation * random.standard_normal((len(pad.sensors), 3))
    return replace(Gains.off_by(pad, deviation), true=true)


def _within(pad: Pad, most: float, random: np.random.Generator) -> Gains:
    """Random gains that are wrong by at most `most`."""
    true = 1.0 + random.uniform(-most, most, (len(pad.sensors), 3))
    return replace(Gains.off_by(pad, most / np.sqrt(3.0)), true=true)


def _after_turn(pad: Pad, random: np.random.Generator) -> Gains:
    """The errors of gains that remain after `baseline --turn`, in a field as uneven as it assumes.

    The field's strength depends on the attitude, because a hand that turns the pad also moves it. No turn can
    distinguish such a difference between x, y and z from gains.
    """
    count, at_rest = len(pad.sensors), _field(pad, State.at_rest(pad))
    true = _drawn(pad, UNTESTED, random).true
    moments = np.linspace(0, TURN_FRAMES, ORIENTATIONS)
    seen = np.array([_earth(moment) + EARTH_AT_FIRST_T for moment in moments])
    unit, stronger = seen / np.linalg.norm(seen, axis=1, keepdims=True), random.normal(0.0, STRENGTH_DEVIATION, (3, 3))
    seen *= 1.0 + np.einsum("ki,ij,kj->k", unit, stronger, unit)[:, None]
    uneven = random.normal(0.0, UNEVEN_DEVIATION_T, (INDEPENDENT, count, 3))
    noise = np.full((count, 3), NOISE_T / np.sqrt(MEAN_OF))
    fields = at_rest + seen[:, None] + np.repeat(uneven, ORIENTATIONS // INDEPENDENT, axis=0)
    measured = true * fields + random.normal(0.0, noise, (ORIENTATIONS, count, 3))
    tolerance = ToleranceConfig(gain=UNTESTED, sensor_rotation_deg=0.0, cross_axis=0.0).si()
    found = sensitivity_from_turn(
        pad, Sensitivity.untested(len(pad.sensors), tolerance), Turn(measured, noise, moments * FRAME_S)
    )
    left = true / found.mean[: true.size].reshape(true.shape)
    return Gains(
        left / left.mean(), np.einsum("iaa->ia", relative_deviation(found.covariance)) / np.sqrt(1.0 - 1.0 / true.size)
    )


def _turned(label: str, ambient: Ambient, pads: Sequence[Gains], frames: int, random: np.random.Generator) -> None:
    """One line of the table, over pads that differ in their gains."""
    health: Counter[str] = Counter()
    turns = [_turn(ambient, gains, frames, health, random) for gains in pads]
    ratios, nees = np.concatenate([one[0] for one in turns]), np.concatenate([one[1] for one in turns])
    not_ok = 1.0 - health["ok"] / health.total()
    if not len(nees):
        print(f"{label:26} no answers | {not_ok:.2%}", flush=True)
        return
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    shown = " ".join(f"{value:8.3f}" for value in rms)
    # A χ² of n degrees of freedom has the mean n and the variance 2n.
    half = 1.96 * np.sqrt(2.0 / (5 * len(nees)))
    honesty = f"{nees.mean() / 5.0:.3f} ({1.0 - half:.3f}–{1.0 + half:.3f})"
    print(f"{label:26} {shown} | {np.sqrt(np.mean(np.square(rms))):8.3f} | {not_ok:.2%} | {honesty}", flush=True)


def _turn(
    ambient: Ambient, gains: Gains, frames: int, health: Counter[str], random: np.random.Generator
) -> tuple[Array, Array]:
    """(K, 5) errors divided by the bound, and (K,) their squares in published deviations.

    The tracker alone solves fields of its own model, so that the errors can be compared with the bound.

    The gains are wrong. The baseline makes the field at rest agree, so only the change since then has their error.
    gains: the true gains for a change, and how well they are known.
    """
    pad, rest = standard_pad(), State.at_rest(standard_pad())
    tracker = FieldTracker(pad, rest, tracking_model_for(SceneConfig(ambient=ambient), MagnetConfig()).tracking, 25.0)
    # The moment absorbs what all gains have in common.
    gain_deviation = gains.deviation * np.sqrt(1.0 - 1.0 / gains.true.size)
    at_rest, ratios, nees = _field(pad, rest), [], []
    for frame in range(frames):
        truth, turned = _pressed(rest, frame), _earth(frame)
        change = _field(pad, truth) + turned - at_rest
        measured = at_rest + gains.true * change + random.normal(0.0, NOISE_T, change.shape)
        deviation = np.hypot(NOISE_T, gain_deviation * change)
        track = tracker.update(measured, deviation, FRAME_S, 25.0)
        health[track.health] += 1
        if frame >= SETTLE_FRAMES and track.estimate is not None:
            error = track.estimate.state.step_from(truth)[:5]
            ratios.append(error / _bound(pad, truth))
            nees.append(error @ np.linalg.solve(track.estimate.covariance[:5, :5], error))
    return np.array(ratios).reshape(-1, 5), np.array(nees)


def _bound(pad: Pad, truth: State) -> Array:
    """(5,) deviations of one frame's pose at the true pose, with the ambient field unknown."""
    exact = solve(_field(pad, truth), pad, truth, deviation_t=NOISE_T, free=FREE_FIELD)
    return np.sqrt(np.diagonal(exact.covariance)[:5])


def _field(pad: Pad, state: State) -> Array:
    magnet = pad.magnet
    place_m = pad.sensors.position_m
    return dipole_field(place_m, state.position_m, state.axis, magnet.strength_t_m3, magnet.modelled_octupole_m2)


def _pressed(rest: State, frame: int) -> State:
    """The pose of a pad that is pressed every 1.5 s: 0.9 mm deep, 0.1 rad tilted."""
    depth = 0.5 * (1.0 - np.cos(2 * np.pi * max(frame * FRAME_S - 0.3, 0.0) / 1.5))
    return rest.stepped(depth * np.array([3e-4, -2e-4, -9e-4, 0.08, 0.05]))


def _earth(frame: float) -> Array:
    """The change of the Earth's field by turning about an axis that itself turns."""
    angle = frame * FRAME_S
    turn = rotation_from_vector(np.array([0.0, 0.0, 0.31 * angle])) @ rotation_from_vector(
        np.array([0.95 * angle, 0, 0])
    )
    return np.asarray(turn @ EARTH_AT_FIRST_T - EARTH_AT_FIRST_T, dtype=np.float64)


def _presses(time_s: float) -> Touch:
    """Presses of 0.8 N for a second with pauses of a second, at changing places."""
    cycle, within_s = divmod(time_s, PRESS_S + PAUSE_S)
    if within_s < PAUSE_S:
        return Touch(0.0, 0.0, 0.0)
    force = 0.4 * (1.0 - np.cos(2 * np.pi * (within_s - PAUSE_S) / PRESS_S))
    return Touch(6e-3 * float(np.cos(2.4 * cycle)), 6e-3 * float(np.sin(2.4 * cycle)), float(force))


class Warming(Simulated):
    """A pad that warms evenly by 20 K with its magnet, whose temperature coefficient is about that of its grade."""

    def __init__(self, config: PadConfig, minutes: float, seed: int) -> None:
        super().__init__(config)
        self._minutes = minutes
        self._magnet_per_k *= 1.0 + COEFFICIENT_SHARE * float(np.random.default_rng(seed).standard_normal())

    def _warming_k(self, now_s: float) -> float:
        return 20.0 * min(now_s / (60.0 * self._minutes), 1.0)


@dataclass(slots=True)
class Warm:
    """The results of warming pads. squares: each pad's mean square of place and force errors, in their deviations."""

    frames: int = 0
    false_contacts: int = 0
    wrong: int = 0
    worst: float = 0.0
    health: Counter[str] = field(default_factory=Counter)
    squares: list[float] = field(default_factory=list)


def _warm(minutes: float, seeds: Sequence[int]) -> None:
    """Run the whole chain: mounted pads, free-running chips, gains ±0.5 %, turning by 20° a second."""
    warm = Warm()
    for seed in seeds:
        _warm_pad(minutes, seed, warm)
    count, mean = len(warm.squares), float(np.mean(warm.squares))
    print(
        f"\n{count} pads warming from 25 to 45 °C in {minutes:g} min, turning, pressed every 2 s: {warm.frames} frames,"
    )
    print(f"{dict(warm.health)}")
    print(f"frames in contact {RELEASE_S * 1e3:.0f} ms or more without force: {warm.false_contacts}")
    print(f"wrong: {warm.wrong}; worst {warm.worst:.1f} sd")
    print(f"mean square of place and force errors, in published deviations: {mean:.3f} (below 1: careful); by pad:")
    print(" ".join(f"{square:.2f}" for square in warm.squares))


def _warm_pad(minutes: float, seed: int, warm: Warm) -> None:
    config = PadConfig(
        name="warm",
        source=SimulatedSource(seed=seed, finger="none", turning_deg_per_s=20.0),
        tolerance=AS_DRAWN,
        scene=SceneConfig(ambient="drifting"),
    )
    pipeline = pipeline_of(config, load_contact_model(config))
    source = Warming(config, minutes, seed)
    source.finger = _presses
    truth = Truth(source.built, _presses)
    squares: list[float] = []
    for step in range(round(minutes * 60.0 / FRAME_S)):
        for frame in source.poll(round(step * FRAME_S * 1e9)):
            message = pipeline.process(frame)
            warm.frames += 1
            warm.health[message.health] += 1
            time_s = message.t_sample_ns * 1e-9
            unloaded = _presses(time_s).force_n == _presses(time_s - RELEASE_S).force_n == 0.0
            warm.false_contacts += message.contact is True and unloaded
            off = truth.deviations(message)
            warm.wrong += off > WRONG_DEVIATIONS
            warm.worst = max(warm.worst, off)
            if message.x_m is not None:
                squares += [error**2 for error in truth.contact_errors(message)]
    warm.squares.append(float(np.mean(squares)))
