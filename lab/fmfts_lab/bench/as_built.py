"""Pads as people build them: chips turned by hand, gains off, an uneven field; what each baseline makes of them.

The pads are drawn here, not by the daemon's simulation: exact rotations of the chips, cross-axis sensitivities,
offsets, gains, places, tilt and strength of the magnet; and the Earth's field of a workshop, whose strength depends on
the attitude.
"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.request import REFINE_S, TURN_S, BaselineRequest
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array, Pad, SensorArray
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.sensor.frame import WireFrame
from fmfts.simulation.cylinder import cylinder_field
from fmfts.simulation.finger import Finger, Touch, columns, no_finger
from fmfts.simulation.mounted import MountedPad
from fmfts_lab.bench.tapped import ManyFrames, without_baseline
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS, Truth

Kind = Literal["bare + rest", "+ refine", "+ turn", "+ turn + refine"]
KINDS: tuple[Kind, ...] = ("bare + rest", "+ refine", "+ turn", "+ turn + refine")
RATE_HZ = 220
ROTATIONS_DEG, GAINS = (0.0, 0.5, 1.0, 2.0), (0.005, 0.05)
EARTH_T, UNEVEN, GRADIENT_T = 0.5e-4, 0.005, 5e-8
CROSS_AXIS, OFFSET_T = 0.002, 1e-6
TURNING_DEG_PER_S = 20.0
# RELEASE_FRAMES quiet frames end a contact, and one frame in a hundred is not quiet by noise alone.
RELEASE_S = 0.2
WITHIN_DEVIATIONS = 2.0
X, Y, Z = np.eye(3)


@dataclass(frozen=True, slots=True)
class Defects:
    """What one row of the table does to a pad; standard deviations."""

    rotation_deg: float
    gain: float
    turning: bool

    @property
    def label(self) -> str:
        return f"{self.rotation_deg:3.1f}° {self.gain:5.1%} {'turning' if self.turning else 'still':7}"


def rotations(axis: Array, angle: Array) -> Array:
    """Matrices (…, 3, 3) that turn by `angle` (…) about the unit vector `axis` (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.asarray(angle)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def _turned_by(vector_rad: Array) -> Array:
    size = float(np.linalg.norm(vector_rad))
    return rotations(vector_rad / size, np.array(size)) if size else np.eye(3)


class BuiltSource(ManyFrames):
    """A simulated pad with another world behind it. attitude: how the robot moves."""

    def __init__(self, config: PadConfig, defects: Defects, random: np.random.Generator) -> None:
        super().__init__(config, perfect=True)
        self._built = _drawn(config.pad(), self._built, defects, random)
        count = len(self._built.pad.sensors)
        self._offset_t = random.normal(0.0, OFFSET_T, (count, 3))
        self._strength = random.normal(0.0, UNEVEN, (3, 3))
        gradient = random.normal(0.0, GRADIENT_T / 11e-3, (3, 3))
        gradient = (gradient + gradient.T) / 2.0
        self._gradient_t_per_m = gradient - np.eye(3) * np.trace(gradient) / 3.0
        self.attitude: Literal["still", "tumbling", "turning"] = "still"

    def recorded(self, seconds: float) -> list[WireFrame]:
        """The next frames, from time zero of a new recording."""
        self._sequence = 0
        self._delivered[:] = np.iinfo(np.int64).min
        return [frame for batch in self.batches(round(seconds * RATE_HZ)) for frame in batch]

    def _attitudes(self, time_s: Array) -> Array:
        """(…, 3, 3) from axes of the room to axes of the pad."""
        if self.attitude == "tumbling":  # once about each axis
            turns = 3.0 * time_s / TURN_S
            x, y, z = (2.0 * np.pi * np.clip(turns - axis, 0.0, 1.0) for axis in range(3))
            return rotations(X, x) @ rotations(Y, y) @ rotations(Z, z)
        turning = np.deg2rad(TURNING_DEG_PER_S) if self.attitude == "turning" else 0.0
        return rotations(np.array([0.48, 0.6, 0.64]), turning * time_s)

    def _fields(self, sampled_s: Array) -> Array:
        attitude = self._attitudes(sampled_s)
        earth = np.einsum("...ij,j->...i", attitude, self._built.ambient_t)
        unit = earth / EARTH_T
        earth *= (1.0 + np.einsum("...i,ij,...j->...", unit, self._strength, unit))[..., None]
        here = (
            attitude
            @ self._gradient_t_per_m
            @ attitude.swapaxes(-1, -2)
            @ self._built.pad.sensors.position_m[..., None]
        )
        field_t = earth + here[..., 0]
        if self.mounted:
            touches = columns([self.finger(moment) for moment in sampled_s.ravel().tolist()])
            position_m, axis = (each.reshape(*sampled_s.shape, 3) for each in self._built.pose(*touches))
            field_t = field_t + cylinder_field(
                self._built.pad.sensors.position_m, position_m, axis, self._built.pad.magnet
            )
        return self._built.sensed(field_t) + self._offset_t


def _drawn(drawing: Pad, exact: MountedPad, defects: Defects, random: np.random.Generator) -> MountedPad:
    count = len(drawing.sensors)
    turned = [_turned_by(vector) for vector in np.deg2rad(random.normal(0.0, defects.rotation_deg, (count, 3)))]
    tilt = _turned_by(np.append(np.deg2rad(random.normal(0.0, 1.0, 2)), 0.0))
    place_m = drawing.sensors.position_m + random.normal(0.0, 1e-4, (count, 3))
    across = np.triu(random.normal(0.0, CROSS_AXIS, (count, 3, 3)), 1)
    direction = random.standard_normal(3)
    from_z = tilt @ exact.rest_axis_from_z
    pad = replace(
        drawing,
        sensors=SensorArray(place_m, drawing.sensors.axes @ np.array(turned)),
        magnet=drawing.magnet.with_remanence(drawing.magnet.remanence_t * float(np.exp(random.normal(0.0, 0.05)))),
        rest_position_m=drawing.rest_position_m + random.normal(0.0, 1e-4, 3),
        rest_axis=from_z[:, 2],
    )
    gain = random.normal(1.0, defects.gain, (count, 3))
    ambient_t = EARTH_T * direction / np.linalg.norm(direction)
    return MountedPad(pad, gain, ambient_t, from_z, exact.mechanics, across + across.transpose(0, 2, 1))


class Presses:
    """A Finger: presses of `hold_s` anywhere, 0.2 to 2 N, each after a pause as long."""

    def __init__(self, random: np.random.Generator, hold_s: float = 0.8) -> None:
        self._hold_s = hold_s
        self._each = np.column_stack([random.uniform(-1e-2, 1e-2, (64, 2)), random.uniform(0.2, 2.0, 64)])

    def __call__(self, time_s: float) -> Touch:
        cycle, within = divmod(time_s / self._hold_s, 2.0)
        x, y, force = self._each[int(cycle) % len(self._each)]
        rise = min(max(min((within - 1.0) / 0.25, (2.0 - within) / 0.25), 0.0), 1.0)
        return Touch(float(x), float(y), float(force) * rise) if rise else Touch(0.0, 0.0, 0.0)


@dataclass(slots=True)
class Cell:
    """The results of one kind of baseline on all pads of one row."""

    pads: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    frames: int = 0
    health: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    worst: float = 0.0
    false_contacts: int = 0
    rest_frames: int = 0
    errors: list[list[float]] = field(default_factory=list)
    off_m: list[float] = field(default_factory=list)
    off_n: list[float] = field(default_factory=list)

    @property
    def line(self) -> str:
        if not self.frames:
            return f"refused {self.refused.total()} of {self.pads}: {dict(self.refused)}"
        published = sum(self.health[name] for name in PUBLISHED) / self.frames
        within = np.mean(np.array(self.errors) <= WITHIN_DEVIATIONS) if self.errors else np.nan
        error = f"{np.mean(self.off_m) * 1e3:.3f} mm {np.mean(self.off_n):.4f} N" if self.off_m else "no contact"
        return (
            f"ok {self.health['ok'] / self.frames:7.2%}, published {published:7.2%}, "
            f"{self.wrong:4d} wrong of {self.frames}, worst {self.worst:5.1f} sd, "
            f"within 2 sd {within:6.2%}, error {error}, "
            f"false contact {self.false_contacts / max(self.rest_frames, 1):.2%}, "
            f"refused {self.refused.total()}"
            + "".join(f"\n    {count} × {reason}" for reason, count in self.refused.items())
        )

    @property
    def facts(self) -> dict[str, object]:
        errors = np.array(self.errors) if self.errors else np.full((1, 3), np.nan)
        return {
            "pads": self.pads,
            "refused": dict(self.refused),
            "frames": self.frames,
            "health": dict(self.health),
            "wrong": self.wrong,
            "worst_sd": self.worst,
            "within_2_sd": float(np.mean(errors <= WITHIN_DEVIATIONS)),
            "place_error_m": float(np.mean(self.off_m)) if self.off_m else None,
            "force_error_n": float(np.mean(self.off_n)) if self.off_n else None,
            "false_contact_frames": self.false_contacts,
            "rest_frames": self.rest_frames,
        }

    def saw(self, messages: Iterable[ContactMessage], truth: Truth, finger: Finger) -> None:
        messages = list(messages)
        deviations = truth.all_deviations(messages)
        self.frames += len(messages)
        self.health.update(message.health for message in messages)
        self.wrong += int((deviations > WRONG_DEVIATIONS).sum())
        self.worst = max(self.worst, float(deviations.max()))
        for message in messages:
            time_s = message.t_sample_ns * 1e-9
            touch = finger(time_s)
            if touch.force_n == finger(time_s - RELEASE_S).force_n == 0.0:
                self.rest_frames += 1
                self.false_contacts += message.contact is True
            if (
                message.x_m is not None
                and message.y_m is not None
                and message.force_n is not None
                and touch.force_n > 0.1
            ):
                self.errors.append(truth.contact_errors(message))
                self.off_m += [abs(message.x_m - touch.x_m), abs(message.y_m - touch.y_m)]
                self.off_n.append(abs(message.force_n - touch.force_n))


def pad_config(defects: Defects, refine: bool, named: bool) -> PadConfig:
    """named: as shipped, with the tolerances of rotation and cross-axis; else without, as before there were any."""
    unnamed = {} if named else {"sensor_rotation_deg": 0.0, "cross_axis": 0.0}
    return PadConfig(
        name="built",
        source=SimulatedSource(finger="none", turning_deg_per_s=0.0),
        tolerance=ToleranceConfig(gain=defects.gain, **unnamed),
        scene=SceneConfig(ambient="drifting" if defects.turning else "constant"),
        # The fingers of these worlds do not shear: else the deviations are twice as wide, and hide what is wrong.
        contact=ContactConfig(refine=refine, friction=0.0),
    )


def baselines_of(config: PadConfig, source: BuiltSource, random: np.random.Generator) -> dict[Kind, Baseline | str]:
    """Each kind of baseline, or why it was refused; with frames as a daemon records them."""

    def made(
        before: Baseline | str | None, *, bare: bool = False, turn: bool = False, refine: bool = False
    ) -> Baseline | str:
        if isinstance(before, str):
            return before
        request = BaselineRequest(config.pad(), config.tolerance.si(), bare, False, turn=turn, refine=refine)
        source.mounted, source.attitude = not bare, "tumbling" if turn else "still"
        source.finger = Presses(random, REFINE_S / 64) if refine else no_finger
        try:
            return request.make(source.recorded(request.seconds), before)[0]
        except BaselineError as error:
            return str(error)

    rest = made(made(None, bare=True))
    turned = made(rest, turn=True)
    refined, both = made(rest, refine=True), made(turned, refine=True)
    return {"bare + rest": rest, "+ refine": refined, "+ turn": turned, "+ turn + refine": both}


def trial(
    defects: Defects, seed: int, seconds: float, cells: dict[Kind, Cell], model: ContactModel, refine: bool, named: bool
) -> None:
    random = np.random.default_rng(
        [seed, round(defects.rotation_deg * 10), round(defects.gain * 1000), defects.turning]
    )
    config = pad_config(defects, refine, named)
    source = BuiltSource(config, defects, random)
    baselines = baselines_of(config, source, random)
    for kind, baseline in baselines.items():
        cell = cells[kind]
        cell.pads += 1
        if isinstance(baseline, str):
            cell.refused[baseline.split("refused: ", 1)[-1]] += 1
            continue
        pipeline = without_baseline(config, model)
        pipeline.use(baseline)
        finger = Presses(np.random.default_rng(seed))
        source.mounted, source.finger = True, finger
        source.attitude = "turning" if defects.turning else "still"
        answers = [pipeline.answer(frame) for frame in source.recorded(seconds)]
        messages = (one.message if isinstance(one, PackedMessage) else one for one in answers)
        cell.saw(messages, Truth(source.built, finger), finger)


def run(options: Namespace) -> None:
    found: list[dict[str, object]] = []
    for rotation_deg in options.rotations:
        for gain in options.gains:
            for turning in (False, True):
                defects = Defects(rotation_deg, gain, turning)
                cells: dict[Kind, Cell] = {kind: Cell() for kind in KINDS}
                model = load_contact_model(pad_config(defects, options.refine, True))
                for seed in range(options.seed, options.seed + options.pads):
                    trial(defects, seed, options.seconds, cells, model, options.refine, not options.unnamed)
                for kind, cell in cells.items():
                    print(f"{defects.label} {kind:15} {cell.line}", flush=True)
                    found.append(
                        {"rotation_deg": rotation_deg, "gain": gain, "turning": turning, "kind": kind} | cell.facts
                    )
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(found)) + b"\n")
