"""Pads of other silicone, thickness and tilt, and other fingers: are forces and places within their deviations?"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from fmfts.baseline import BaselineError
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts_lab.bench.cast_pads import POISSON, CastFinger, CastMechanics, CastPad, Ramp, ramps, tilted_by
from fmfts_lab.bench.silicone import RealPad, baseline_of, messages_of
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import WRONG_DEVIATIONS, Truth

CALIBRATED_N = 1.9
FELT_N = 0.1
ABOUT_1N = 0.2
RELEASED_S = 0.3  # see as_built.RELEASE_S
FRICTIONS = (0.0, 0.3)
# What the deviations count: "nothing" of the structure, the tolerances of the configuration, or "tilt": silicone,
# thickness and finger are known, so that the deviations must cover only the tilt.
Counted = Literal["nothing", "tolerances", "tilt"]
# As deviations were before they counted the structure: the model's own pad, with a magnet that only tilts.
UNCOUNTED = ToleranceConfig(gain=0.005, magnet_tilt_deg=1.0, pad_tilt_deg=0.0, modulus=0.0, thickness_mm=0.0)
# Then a shearing finger also counted as one of another shape: as far from the probe as these.
UNCOUNTED_FINGER_MM = {0.0: (6.0, 6.0), 0.3: (3.9, 7.6)}


@dataclass(frozen=True, slots=True)
class Cell:
    """One row: how the pad is built, and what presses it. modulus: over the model's. tilt_deg: of the whole pad."""

    name: str
    modulus: float = 1.0
    thickness_mm: float = 4.0
    finger_mm: float = 6.0
    tilt_deg: float = 0.0
    poisson: float = POISSON

    def ramps(self, sheared: bool = False) -> tuple[Ramp, ...]:
        return ramps(CastPad(self.thickness_mm, self.finger_mm, self.poisson), sheared)

    def finger(self, random: np.random.Generator, sheared: bool = False) -> CastFinger:
        """Presses all over this pad, as strong as a calibrated model reads."""
        return CastFinger(self.ramps(sheared), CALIBRATED_N * self.modulus, random)


CELLS = (
    Cell("as the model's"),
    Cell("modulus × 0.6", modulus=0.6),
    Cell("modulus × 0.8", modulus=0.8),
    Cell("modulus × 1.2", modulus=1.2),
    Cell("modulus × 1.4", modulus=1.4),
    Cell("3.6 mm thick", thickness_mm=3.6),
    Cell("4.4 mm thick", thickness_mm=4.4),
    Cell("finger 3 mm", finger_mm=3.0),
    Cell("finger 12 mm", finger_mm=12.0),
    Cell("tilt 1°", tilt_deg=1.0),
    Cell("tilt 2°", tilt_deg=2.0),
    Cell("tilt 3°", tilt_deg=3.0),
    Cell("tilt 4°", tilt_deg=4.0),
    Cell("tilt 5°", tilt_deg=5.0),
    Cell("stiff, 12 mm, 2°", 1.2, 4.0, 12.0, 2.0),
    Cell("soft, thin, 12 mm", 0.8, 3.6, 12.0, 1.0),
    Cell("stiff, thick, 3 mm", 1.2, 4.4, 3.0, 1.0),
)


@dataclass(slots=True)
class Found:
    """The results of one cell with one friction, over all pads. errors: x, y, force of each felt frame, in deviations.
    share: of the force, by which it is off. off_m: outwards from the pad's middle, and along the tilt. off_at_1n_m: of
    the place, at about 1 N."""

    frames: int = 0
    ok: int = 0
    wrong: int = 0
    worst: float = 0.0
    rest_frames: int = 0
    false_contacts: int = 0
    pressed: int = 0
    felt: int = 0
    refused: int = 0
    errors: list[list[float]] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    claimed: list[float] = field(default_factory=list)
    off_m: list[tuple[float, float]] = field(default_factory=list)
    off_at_1n_m: list[float] = field(default_factory=list)

    def saw(self, messages: list[ContactMessage], truth: Truth, finger: CastFinger, towards_rad: float) -> None:
        deviations = truth.all_deviations(messages)
        self.frames += len(messages)
        self.wrong += int((deviations > WRONG_DEVIATIONS).sum())
        self.worst = max(self.worst, float(deviations.max()))
        for message in messages:
            time_s = message.t_sample_ns * 1e-9
            touch = finger(time_s)
            self.ok += message.health == "ok"
            if touch.force_n == finger(time_s - RELEASED_S).force_n == 0.0:
                self.rest_frames += 1
                self.false_contacts += message.contact is True
            if touch.force_n < FELT_N:
                continue
            self.pressed += 1
            self.felt += message.contact is True
            if message.x_m is not None and message.y_m is not None and message.force_n is not None:
                assert message.force_sd_n is not None
                self.errors.append(truth.contact_errors(message))
                self.share.append(message.force_n / touch.force_n - 1.0)
                self.claimed.append(message.force_sd_n / touch.force_n)
                off = np.array([message.x_m - touch.x_m, message.y_m - touch.y_m])
                outwards = np.array([touch.x_m, touch.y_m]) / np.hypot(touch.x_m, touch.y_m)
                along = np.array([np.cos(towards_rad), np.sin(towards_rad)])
                self.off_m.append((float(off @ outwards), float(off @ along)))
                if abs(touch.force_n - 1.0) < ABOUT_1N:
                    self.off_at_1n_m.append(float(np.hypot(*off)))

    @property
    def facts(self) -> dict[str, float]:
        within = np.array(self.errors) <= 2.0
        off_mm = 1e3 * np.array(self.off_m)
        return {
            "frames": self.frames,
            "refused": self.refused,
            "ok": self.ok / self.frames,
            "wrong": self.wrong,
            "worst_sd": self.worst,
            "false_contact": self.false_contacts / max(self.rest_frames, 1),
            "felt": self.felt / max(self.pressed, 1),
            "place_within_2_sd": float(within[:, :2].mean()),
            "force_within_2_sd": float(within[:, 2].mean()),
            "force_off": float(np.mean(self.share)),
            "force_sd": float(np.mean(self.claimed)),
            "outwards_mm": float(off_mm[:, 0].mean()),
            "along_tilt_mm": float(off_mm[:, 1].mean()),
        }


def config_of(cell: Cell, friction: float, seed: int, counted: Counted) -> PadConfig:
    tolerance, finger_mm = {
        "nothing": (UNCOUNTED, UNCOUNTED_FINGER_MM[friction]),
        "tolerances": (ToleranceConfig(gain=0.005), ContactConfig().finger_mm),
        "tilt": (ToleranceConfig(gain=0.005, modulus=0.0, thickness_mm=0.0), (cell.finger_mm, cell.finger_mm)),
    }[counted]
    return PadConfig(
        name="cast",
        source=SimulatedSource(seed=seed, finger="none", turning_deg_per_s=0.0),
        tolerance=tolerance,
        scene=SceneConfig(ambient="constant"),
        contact=ContactConfig(friction=friction, finger_mm=finger_mm),
    )


def cast_pad(
    config: PadConfig, cell: Cell, friction: float, towards_rad: float, noise_t: float | None = None
) -> RealPad:
    """A simulated pad with the chips of its seed, and the silicone and the tilt of the cell."""
    source = RealPad(config, noise_t)
    built = source.built
    tilted = tilted_by(cell.tilt_deg, towards_rad)
    mechanics: Any = CastMechanics(cell.ramps(friction > 0.0), cell.modulus)
    drawn = replace(built.pad, rest_axis=tilted[:, 2])
    source.stands(replace(built, pad=drawn, rest_axis_from_z=tilted, tilted=tilted, mechanics=mechanics))
    return source


def trial(cell: Cell, friction: float, seed: int, options: Namespace, counted: Counted, found: Found) -> None:
    random = np.random.default_rng(seed)
    towards_rad = float(random.uniform(0.0, 2.0 * np.pi))
    config = config_of(cell, friction, seed, counted)
    try:
        baseline = baseline_of(config, cast_pad(config, cell, friction, towards_rad), turn=not options.bare_and_rest)
    except BaselineError:
        found.refused += 1
        return
    pipeline: PadPipeline = without_baseline(config, load_contact_model(config))
    pipeline.use(baseline)
    source = cast_pad(config, cell, friction, towards_rad)
    finger = cell.finger(random, friction > 0.0)
    source.finger = finger
    found.saw(messages_of(pipeline, source.recorded(options.seconds)), Truth(source.built, finger), finger, towards_rad)


def measured(cell: Cell, friction: float, options: Namespace, counted: Counted) -> dict[str, float]:
    found = Found()
    for seed in range(options.seed, options.seed + options.pads):
        trial(cell, friction, seed, options, counted, found)
    return found.facts if found.frames else {"refused": found.refused}


def line(facts: dict[str, float]) -> str:
    if "frames" not in facts:
        return f"refused {facts['refused']:.0f}"
    return (
        f"{facts['wrong']:5.0f} wrong of {facts['frames']:.0f}, worst {facts['worst_sd']:5.1f} sd, within 2 sd place "
        f"{facts['place_within_2_sd']:6.1%} force {facts['force_within_2_sd']:6.1%}, force {facts['force_off']:+6.1%} "
        f"± {facts['force_sd']:.1%}, outwards {facts['outwards_mm']:+.2f} mm, along the tilt "
        f"{facts['along_tilt_mm']:+.2f} mm, false contacts {facts['false_contact']:.2%}, felt {facts['felt']:.1%}, "
        f"ok {facts['ok']:.1%}, refused {facts['refused']:.0f}"
    )


def run(options: Namespace) -> None:
    rows = []
    cells = [cell for cell in CELLS if not options.only or cell.name.startswith(tuple(options.only))]
    ways: list[Counted] = ["tilt"] if options.known else ["tolerances"]
    if options.before:
        ways.insert(0, "nothing")
    for friction in options.frictions:
        for cell in cells:
            for counted in ways:
                facts = measured(cell, friction, options, counted)
                print(f"µ {friction:.1f} {cell.name:20} {counted:10} {line(facts)}", flush=True)
                about = {"seed": options.seed, "pads": options.pads, "cell": cell.name, "tilt_deg": cell.tilt_deg}
                rows.append(about | {"friction": friction, "counted": counted} | facts)
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(rows)) + b"\n")
