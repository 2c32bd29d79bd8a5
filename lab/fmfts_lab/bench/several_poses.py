"""The other way to fingers: solve the poses of all magnets first, without the table of presses; for `--through-poses`.

Beside it the way that fmfts takes: the fingers themselves are the unknowns. Also the Cramér–Rao bound of the poses on
some pads.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fmfts.common.chi2 import quantile
from fmfts.contact.array_model import STANDARD_SENSORS_MM
from fmfts.pad import Array, SensorArray, Tolerance
from fmfts.pose.magnets import CHANGE, Magnets, field_and_slope, rest_frames
from fmfts.pose.observable import FREE_FIELD
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Measured
from fmfts.several.odd_sensor import UNEXPLAINED
from fmfts_lab.bench.several_moves import by_finger, considered_moves
from fmfts_lab.bench.several_world import BUILT, EXACT, NOISE_T, Press, World, any_press, two_places, worlds
from fmfts_lab.bench.workspace import standard_pad
from fmfts_lab.finite_elements.array_pad import array_config

FRAMES_OF_A_PAD = 20
NOTHING = np.zeros(FREE_FIELD)
WRONG_T = (4e-6, 40e-6)  # additional reading of one axis of one sensor
ITERATIONS, SETTLED, DAMPING, MOST_DAMPING = 60, 1e-3, 1e-3, 1e8
LARGEST = np.array([2e-3, 2e-3, 2e-3, 0.5, 0.5])  # largest change of pose of a solution
POSES_DRAWN = 50
PRESSED = np.array([4e-4, 4e-4, 4e-4, 0.1, 0.1])  # deviations of the poses for which the bound is reported


@dataclass(slots=True)
class Way:
    """The results of one way. off (…, 3): errors in mm and N. refused: of the frames with WRONG_T on one axis."""

    spare: int
    solved: int = 0
    frames: int = 0
    off: list[Array] = field(default_factory=list)
    refused: list[int] = field(default_factory=lambda: [0] * len(WRONG_T))

    def line(self, name: str) -> str:
        off = np.array(self.off)
        place = np.hypot(off[:, 0], off[:, 1])
        refused = ", ".join(f"{count / self.frames:.0%}" for count in self.refused)
        return (
            f"| {name} | {self.spare} | {self.solved / self.frames:.1%} of {self.frames:,} | {np.median(place):.2f} "
            f"| {np.quantile(place, 0.9):.2f} | {np.median(np.abs(off[:, 2])):.3f} "
            f"| {np.sqrt(np.mean(np.square(off[:, 2]))):.3f} | {refused} |"
        )


def run(options: Namespace) -> None:
    print(
        "| fingers | values to spare | solved | place, median mm | p90 mm | force, median N | rms N "
        f"| refused with {', '.join(f'{wrong * 1e6:g}' for wrong in WRONG_T)} µT on an axis |\n"
        f"| {' | '.join(['---'] * 8)} |"
    )
    for count, told in ((1, "one"), (2, "two, 10 to 18 mm apart")):
        for name, tolerance in (("as drawn", EXACT), ("as built", BUILT)):
            fingers, poses = _ways(options, tolerance, count)
            print(fingers.line(f"{told}, {name}, the fingers"), flush=True)
            print(poses.line(f"{told}, {name}, through the poses"), flush=True)
    print(
        "\n| magnets, sensors | values to spare | place, rms µm | worst µm | tilt, rms ° | worst ° |\n"
        f"| {' | '.join(['---'] * 6)} |"
    )
    for name, magnets, sensors in _layouts():
        print(_bound(name, magnets, sensors, options.seed), flush=True)


def _ways(options: Namespace, tolerance: Tolerance, count: int) -> tuple[Way, Way]:
    """count: of fingers that press."""
    fingers = poses = None
    for one in worlds(options.frames, tolerance, options.seed + 5, FRAMES_OF_A_PAD):
        values = 3 * len(one.sensors)
        fingers = fingers or Way(values - FREE_FIELD - FINGER * count)
        poses = poses or Way(values - FREE_FIELD - CHANGE * len(one.magnets))
        for _ in range(FRAMES_OF_A_PAD):
            presses = [any_press(one.random)] if count == 1 else _two(one.random)
            truth, change = np.array([press[:3] for press in presses]), one.pressed(presses)
            measured, axis = one.measured(change), int(one.random.integers(values))
            _by_fingers(fingers, one, measured, truth, axis)
            _by_poses(poses, one, measured, truth, change, axis)
    assert fingers is not None
    assert poses is not None
    return fingers, poses


def _wrong(measured: Measured, axis: int, wrong_t: float) -> Measured:
    off = measured.field_t.copy()
    off[axis] += wrong_t
    return Measured(off, measured.variance_t2, measured.used)


def _by_fingers(way: Way, one: World, measured: Measured, truth: Array, axis: int) -> None:
    fit, limit = one.fitter.fit(truth, measured, NOTHING), quantile(UNEXPLAINED, way.spare)
    way.frames, way.solved = way.frames + 1, way.solved + 1
    way.off.extend(fit.fingers - truth)
    for number, wrong_t in enumerate(WRONG_T):
        way.refused[number] += one.fitter.fit(truth, _wrong(measured, axis, wrong_t), NOTHING).chi2 > limit


def _by_poses(way: Way, one: World, measured: Measured, truth: Array, change: Array, axis: int) -> None:
    way.frames += 1
    solved, limit = _poses(one, measured, change), quantile(UNEXPLAINED, way.spare)
    if solved is not None:
        way.solved += 1
        way.off.extend(_fingers_of(one, *solved[:2], truth) - truth)
    for number, wrong_t in enumerate(WRONG_T):
        there = _poses(one, _wrong(measured, axis, wrong_t), change)
        way.refused[number] += there is None or there[2] > limit


def _poses(one: World, measured: Measured, true: Array) -> tuple[Array, Array, float] | None:
    """The most likely change of the poses (5M,), with the ambient field free, its covariance, and χ²; None where the
    search does not end. It begins at the `true` one, so that the start does not matter.
    """
    mounting, model = one.mounting, one.fitter.model
    scale = np.concatenate([np.tile(LARGEST, len(mounting.magnets)), [1e-4] * FREE_FIELD])
    moment = one.fitter.model.scene.moment * mounting.rest_field_t.ravel()
    errors = mounting.errors.at(true, NOTHING)
    noise = np.diag(measured.variance_t2) + np.outer(moment, moment) + errors @ errors.T
    root = np.linalg.inv(np.linalg.cholesky(noise))

    def white(state: Array) -> tuple[Array, Array]:
        moved = mounting.magnets.changed((state * scale)[: len(true)], mounting.frames)
        field_t, slope = field_and_slope(moved, mounting.frames, mounting.sensors)
        expected = (field_t - mounting.rest_field_t).ravel() + model.by_ambient @ (state * scale)[len(true) :]
        return root @ (measured.field_t - expected), root @ np.concatenate([slope, model.by_ambient], axis=1) * scale

    state, damping = np.concatenate([true, NOTHING]) / scale, DAMPING
    residual, slope = white(state)
    for _ in range(ITERATIONS):
        normal = slope.T @ slope
        step = np.linalg.solve(normal + damping * np.diag(np.diagonal(normal)), slope.T @ residual)
        tried, by = white(state + step)
        if tried @ tried > residual @ residual or np.abs(state + step).max() > 1.0:
            damping *= 10.0
            if damping > MOST_DAMPING:
                break
            continue
        small = (residual @ residual - tried @ tried) < SETTLED
        state, residual, slope, damping = state + step, tried, by, damping / 10.0
        if small:
            break
    else:
        return None
    covariance = np.linalg.inv(slope.T @ slope) * scale * scale[:, None]
    return (state * scale)[: len(true)], covariance[: len(true), : len(true)], float(residual @ residual)


def _fingers_of(one: World, change: Array, covariance: Array, truth: Array) -> Array:
    """(K, 3) the fingers that fit the poses best, by their covariance and the effects that the model of fingers
    considers.
    """
    fingers, model, table = truth.copy(), one.fitter.model, one.response
    for _ in range(ITERATIONS):
        predicted = model.predict(fingers)
        moves, slope = considered_moves(model, fingers, predicted), by_finger(model, predicted)
        weight = np.linalg.inv(covariance + moves @ moves.T)
        step = np.linalg.solve(slope.T @ weight @ slope, slope.T @ weight @ (change - predicted.change)).reshape(-1, 3)
        step *= min(1.0, 2.0 / max(float(np.abs(step[:, :2]).max()), 1e-9))
        fingers = np.clip(
            fingers + step, [table.first_mm, table.first_mm, 0.0], [table.last_mm, table.last_mm, 3.0 * table.scale_n]
        )
        if np.abs(step).max() < SETTLED:
            break
    return fingers


def _two(random: np.random.Generator) -> list[Press]:
    """Two fingers of 0.3 to 1 N, far enough apart to be distinguished."""
    places = two_places(random, random.uniform(10.0, 18.0))
    return [Press(x, y, random.uniform(0.3, 1.0)) for x, y in places.tolist()]


def _layouts() -> list[tuple[str, Magnets, SensorArray]]:
    four = Magnets.drawn(array_config().pad())
    two = Magnets(
        np.array([[6e-3, 0.0, 12e-3], [-6e-3, 0.0, 12e-3]]), four.axis[:2], four.strength_t_m3[:2], four.octupole_m2[:2]
    )
    along = np.array([-13.5, -4.5, 4.5, 13.5])
    grid = np.array([[x, y, 0.0] for x in along for y in along])

    inner = grid[(np.abs(grid[:, :2]) > 9.0).sum(axis=1) < 2]
    single = standard_pad()
    eight = _sensors(STANDARD_SENSORS_MM)
    return [
        ("1 over 4 (the first pad)", Magnets.drawn(single), single.sensors),
        ("2 over 8, (±6, 0) mm", two, eight),
        ("4 over 8", four, eight),
        ("4 over 12, a 4 × 4 grid of 9 mm without its corners", four, _sensors(inner)),
        ("4 over 16, a 4 × 4 grid of 9 mm", four, _sensors(grid)),
    ]


def _sensors(place_mm: Array | Sequence[Sequence[float]]) -> SensorArray:
    return SensorArray.aligned(np.asarray(place_mm) * 1e-3)


def _bound(name: str, magnets: Magnets, sensors: SensorArray, seed: int) -> str:
    """The bound of all poses together, by the noise of one frame, with a free ambient field: rms and worst of some
    poses.
    """
    random, frames, size = np.random.default_rng((seed, 29)), rest_frames(magnets.axis), CHANGE * len(magnets)
    by_ambient = sensors.axes.transpose(0, 2, 1).reshape(3 * len(sensors), 3)
    variances = []
    for _ in range(POSES_DRAWN):
        moved = magnets.changed(random.normal(0.0, np.tile(PRESSED, len(magnets))), frames)
        slope = np.concatenate([field_and_slope(moved, frames, sensors)[1], by_ambient], axis=1) / NOISE_T
        scale = np.concatenate([np.tile(LARGEST, len(magnets)), [1e-4] * FREE_FIELD])
        inverse = np.linalg.inv((slope * scale).T @ (slope * scale)) * scale * scale[:, None]
        variances.append(np.diagonal(inverse)[:size].reshape(-1, CHANGE))
    each = np.array(variances)
    place, tilt = 1e6 * np.sqrt(each[..., :3]), np.rad2deg(np.sqrt(each[..., 3:]))
    return (
        f"| {name} | {3 * len(sensors) - FREE_FIELD - size} | {_rms(place):.1f} | {place.max():.0f} "
        f"| {_rms(tilt):.3f} | {tilt.max():.2f} |"
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
