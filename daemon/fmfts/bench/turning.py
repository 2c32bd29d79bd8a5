"""A pressed pad on a robot that turns in the Earth's field: what the drifting field costs, and what warmth does."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter

import numpy as np

from fmfts.bench.faults import pipeline_of
from fmfts.bench.truth import WRONG_DEVIATIONS, Truth
from fmfts.bench.workspace import Array, standard_pad
from fmfts.config import MagnetConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.pad import Pad, rotation_from_vector
from fmfts.pose import FREE_FIELD, State, Tracker, dipole_field, solve
from fmfts.scene import choose
from fmfts.sensor.simulated import Simulated
from fmfts.simulate.finger import Touch

NOISE_T = 2e-7
EARTH_T = 0.5e-4
FRAME_S = 1.0 / 220.0
SETTLE_FRAMES = 110
PRESS_S, PAUSE_S = 1.0, 1.0


def run(options: Namespace) -> None:
    frames = round(options.seconds / FRAME_S)
    print(f"half a gauss through all directions at 1 rad/s, pressed; {frames} frames, white noise of 2 mG")
    print("RMSE over the single-frame bound with eight unknowns: x y z tilt1 tilt2 | all | not ok\n")
    for label, ambient, gain in (
        ("drifting, perfect gains", "drifting", 0.0),
        ("drifting, gains ±0.5 %", "drifting", 0.005),
        ("constant, perfect gains", "constant", 0.0),
    ):
        _turn(label, ambient, gain, frames, np.random.default_rng(options.seed))
    _warm(options.warm_minutes, options.seed)


def _turn(label: str, ambient: str, gain: float, frames: int, random: np.random.Generator) -> None:
    """The tracker alone, against dipole fields, so that the bound is the only yardstick.

    Gains are off, the baseline has made rest agree: what remains is their error on what changed since.
    """
    pad, rest = standard_pad(), State.at_rest(standard_pad())
    scene = SceneConfig(ambient="drifting" if ambient == "drifting" else "constant")
    tracker = Tracker(pad, rest, choose(scene, MagnetConfig()).tracking, 25.0)
    gains = 1.0 + gain * random.standard_normal((len(pad.sensors), 3))
    at_rest = _field(pad, rest)
    ratio, health = [], Counter[str]()
    for frame in range(frames):
        truth, turned = _pressed(rest, frame), _earth(frame)
        change = _field(pad, truth) + turned - at_rest
        measured = at_rest + gains * change + random.normal(0.0, NOISE_T, change.shape)
        deviation = np.hypot(NOISE_T, gain * change)
        track = tracker.update(measured, deviation, FRAME_S, 25.0)
        health[track.health] += 1
        if frame < SETTLE_FRAMES or track.estimate is None:
            continue
        error = track.estimate.state.step_from(truth)[:5]
        ratio.append(error / _bound(pad, truth))
    rms = np.sqrt(np.mean(np.square(ratio), axis=0))
    shown = " ".join(f"{value:8.3f}" for value in rms)
    not_ok = 1.0 - health["ok"] / frames
    print(f"{label:26} {shown} | {np.sqrt(np.mean(np.square(rms))):8.3f} | {not_ok:.2%}")


def _bound(pad: Pad, truth: State) -> Array:
    """(5,) deviations of one frame's pose at the truth, its ambient field free."""
    exact = solve(_field(pad, truth), pad, truth, deviation_t=NOISE_T, free=FREE_FIELD)
    return np.sqrt(np.diagonal(exact.covariance)[:5])


def _field(pad: Pad, state: State) -> Array:
    return dipole_field(pad.sensors.position_m, state.position_m, state.axis, pad.magnet.strength_t_m3)


def _pressed(rest: State, frame: int) -> State:
    """Pressed and let go every 1.5 s: 0.9 mm deep, 0.1 rad tilted."""
    depth = 0.5 * (1.0 - np.cos(2 * np.pi * max(frame * FRAME_S - 0.3, 0.0) / 1.5))
    return rest.stepped(depth * np.array([3e-4, -2e-4, -9e-4, 0.08, 0.05]))


def _earth(frame: int) -> Array:
    """What turning has changed of the Earth's field: about an axis that goes round itself."""
    angle = frame * FRAME_S
    turn = rotation_from_vector(np.array([0.0, 0.0, 0.31 * angle])) @ rotation_from_vector(
        np.array([0.95 * angle, 0, 0])
    )
    start = EARTH_T * np.array([0.6, -0.64, 0.48])
    return np.asarray(turn @ start - start, dtype=np.float64)


def _presses(time_s: float) -> Touch:
    """A second's press of 0.8 N, a second's pause, wandering over the pad."""
    cycle, within_s = divmod(time_s, PRESS_S + PAUSE_S)
    if within_s < PAUSE_S:
        return Touch(0.0, 0.0, 0.0)
    force = 0.4 * (1.0 - np.cos(2 * np.pi * (within_s - PAUSE_S) / PRESS_S))
    return Touch(6e-3 * float(np.cos(2.4 * cycle)), 6e-3 * float(np.sin(2.4 * cycle)), float(force))


class Warming(Simulated):
    """A pad that warms evenly by 20 K, with the magnet inside."""

    minutes: float = 10.0

    def _warming_k(self, now_s: float) -> float:
        return 20.0 * min(now_s / (60.0 * self.minutes), 1.0)


def _warm(minutes: float, seed: int) -> None:
    """The whole chain: mounted pad, chips on their own clocks, gains ±0.5 %, turning by 20° a second."""
    config = PadConfig(
        name="warm",
        source=SimulatedSource(seed=seed, finger="none", turning_deg_per_s=20.0),
        tolerance=ToleranceConfig(gain=0.005),
        scene=SceneConfig(ambient="drifting"),
    )
    pipeline = pipeline_of(config, ContactModel.load("default", config.pad()))
    source = Warming(config)
    source.minutes, source.finger = minutes, _presses
    truth = Truth(source.built, _presses)
    health: Counter[str] = Counter()
    false_contacts, wrong, worst, frames = 0, 0, 0.0, 0
    squares: list[float] = []
    touched: bool | None = None
    for step in range(round(minutes * 60.0 / FRAME_S)):
        for frame in source.poll(round(step * FRAME_S * 1e9)):
            message = pipeline.process(frame)
            frames += 1
            health[message.health] += 1
            touch = _presses(message.t_sample_ns * 1e-9)
            false_contacts += message.contact is True and touched is not True and touch.force_n == 0.0
            touched = message.contact
            off = truth.deviations(message)
            wrong += off > WRONG_DEVIATIONS
            worst = max(worst, off)
            if message.x_m is not None:
                squares += [error**2 for error in truth.contact_errors(message)]
    print(f"\nwarming from 25 to 45 °C in {minutes:g} min, turning, pressed every 2 s: {frames} frames, {dict(health)}")
    print(f"contacts that begin without force: {false_contacts}; wrong: {wrong}; worst {worst:.1f} deviations")
    print(f"mean square of place and force errors, in published deviations: {np.mean(squares):.3f} (below 1: careful)")
