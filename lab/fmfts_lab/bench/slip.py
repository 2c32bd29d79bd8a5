"""Slip: how often and how soon it is noticed, false alarms of healthy fingers, and the learned friction."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, cast

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage, SlipMessage
from fmfts.config import ContactConfig, PadConfig
from fmfts.contact import ContactModel
from fmfts.contact.refinement import Refiner
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.bounds import bound_of
from fmfts_calibrate.samples import Samples
from fmfts_calibrate.tracked import FrameSolver, upright
from fmfts_lab.bench.drills import RATE_HZ, Ambient, pad_config
from fmfts_lab.bench.now_pads import BuiltPad
from fmfts_lab.bench.slip_soonest import Timed, Timer, lines, soonest_s
from fmfts_lab.bench.slip_world import HEALTHY, Drag, Dragged, DragMechanics, Healthy, Slide, ToolNearby
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_lab.bench.workspace import standard_pad
from fmfts_lab.calibration.simulated import rest_field_of
from fmfts_simulation.mechanics import Mechanics

SPEEDS_MM_PER_S = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
AMBIENTS: tuple[Ambient, Ambient] = ("constant", "drifting")
SHAPES = ("round", "ball", "flat", "edge")
SHEARED, STEPS = 0.3, 40  # of the bound; number of trials of an inversion
BOUND_AT = ((0.0, 0.5), (0.0, 1.0), (0.0, 2.0), (4.0, 1.0), (8.0, 1.0), (8.0, 2.0), (10.0, 2.0))
BOUND_MM_PER_S = (5.0, 50.0)
EARLY_S, LATE_S = 0.01, 0.05  # time around a slip in which its onset counts as found


def config_of(ambient: Ambient, seed: int, shape: str = "round", creeps: bool = False) -> PadConfig:
    config = pad_config(ambient, seed)
    source = msgspec.structs.replace(config.source, finger_shape=shape, imperfections=("silicone",) if creeps else ())
    return msgspec.structs.replace(config, source=source, contact=ContactConfig(model="shear", slip=True))


@dataclass(slots=True)
class Seen:
    """The published slips: delays_s, infinite for a missed one; friction: true, published, deviation."""

    delays_s: list[float] = field(default_factory=list)
    onsets: int = 0
    false: int = 0
    friction: list[tuple[float, float, float]] = field(default_factory=list)

    def take(self, messages: list[ContactMessage], begin_s: float, end_s: float, friction: float) -> None:
        time_s = np.arange(len(messages)) / RATE_HZ
        slipping = np.array([message.slipping for message in messages])
        onset_s = time_s[slipping & ~np.append(False, slipping[:-1])]
        inside = (onset_s >= begin_s - EARLY_S) & (onset_s <= end_s + LATE_S)
        self.onsets += int(inside.sum())
        self.false += int((~inside).sum())
        self.delays_s.append(float(onset_s[inside][0] - begin_s) if inside.any() else np.inf)
        after = [
            one.slip for one, t in zip(messages, time_s, strict=True) if t > begin_s and one.slip is not msgspec.UNSET
        ]
        known = [one for one in after if isinstance(one, SlipMessage) and one.friction is not None]
        if inside.any() and known:
            self.friction.append((friction, known[-1].friction or 0.0, known[-1].friction_sd or 0.0))

    def line(self, name: str) -> str:
        delay, count = np.array(self.delays_s), len(self.delays_s)
        told = f"{name:22} {np.isfinite(delay).mean():6.1%} of {count:4d}, median {np.median(delay) * 1e3:5.0f} ms, "
        told += f"{self.onsets / count:.2f} onsets a slip, {self.false} false"
        if not self.friction:
            return told
        true, found, deviation = np.array(self.friction).T
        error = found - true
        return told + (
            f"; friction: median error {np.median(np.abs(error)):.3f}, "
            f"within 0.05 {np.mean(np.abs(error) < 0.05):.0%}, "
            f"bias {error.mean():+.3f}, {np.sqrt(np.mean((error / deviation) ** 2)):.2f} in deviations"
        )


def messages(pad: BuiltPad, source: ManyFrames, seconds: float) -> list[ContactMessage]:
    pipeline = pad.pipeline()
    return [pipeline.process(frame) for frames in source.batches(round(seconds * RATE_HZ)) for frame in frames]


def run(options: Namespace) -> None:
    random = np.random.default_rng(options.seed)
    parts: dict[str, Callable[[], None]] = {
        "bound": bound,
        "table": lambda: of_table(options, random),
        "drags": lambda: of_drags(options),
        "healthy": lambda: healthy(options, random),
    }
    for name, part in parts.items():
        if options.part in (None, name):
            part()


def bound() -> None:
    """The least deviations of place, force and shear from one frame, and those of a place whose shear is known."""
    pad = standard_pad()
    response = ContactModel.load("shear", pad).response
    assert response is not None
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    print(f"one frame, shear x {SHEARED:g} of the force: x, y (mm), force, shear x, y (N); x, y without shear;")
    print(f"and when a slip along x may be noticed at {', '.join(f'{each:g}' for each in BOUND_MM_PER_S)} mm/s (ms)")
    for x_mm, force_n in BOUND_AT:
        expected = Samples.expected(response, solver, np.array([[x_mm, 0.0, force_n, SHEARED * force_n, 0.0]]))
        slope = response.change_and_slope(expected.press)[1]
        known = bound_of(slope[:, :, :3], expected.covariance)[0]
        told = "".join(f"{value:8.3f}" for value in (*expected.bound[0], *known[:2]))
        soonest = "".join(f"{1e3 * soonest_s(float(expected.bound[0, 0]), each):6.0f}" for each in BOUND_MM_PER_S)
        print(f"  ({x_mm:g}, 0) mm, {force_n:g} N {told} |{soonest}")


def of_table(options: Namespace, random: np.random.Generator) -> None:
    """Slides of four shapes of fingers on built pads: friction 0.3 to 1.2, within 7 mm, silicone that creeps."""
    print(f"slides by the table of presses, {options.slides} a speed")
    pads: dict[tuple[Any, ...], BuiltPad] = {}
    everything, timer, timed = Seen(), Timer.standard(), list[Timed]()
    for speed in SPEEDS_MM_PER_S:
        seen = Seen()
        for number in range(options.slides):
            kind = AMBIENTS[number % 2], 100 * options.seed + number % 3, SHAPES[number % len(SHAPES)], True
            pad = pads.setdefault(kind, BuiltPad.of(config_of(*kind))) if kind not in pads else pads[kind]
            slide, source = Slide.drawn(random, speed * 1e-3), ManyFrames(pad.config)
            source.finger = slide
            told = messages(pad, source, slide.seconds)
            for each in (seen, everything):
                each.take(told, *slide.slips_s, slide.friction)
            timed.append(timer.timed(slide, seen.delays_s[-1]))
        print(seen.line(f"  {speed:g} mm/s"))
    print(everything.line("  all"))
    print(*lines(timed), sep="\n")


def of_drags(options: Namespace) -> None:
    """CalculiX's drags at each speed, on built pads."""
    print("balls that CalculiX dragged, with Coulomb's friction")
    for drag in Drag.read():
        seen = Seen()
        for number, speed in enumerate(SPEEDS_MM_PER_S * options.repeats):
            config = config_of(AMBIENTS[number % 2], 100 * options.seed + number % 3)
            pad, dragged = BuiltPad.of(config), Dragged(drag, speed * 1e-3)
            source = ManyFrames(pad.config)
            source._built = replace(source._built, mechanics=cast(Mechanics, DragMechanics(drag)))
            source.finger = dragged
            seen.take(messages(pad, source, dragged.seconds), *dragged.slips_s, drag.friction)
        print(seen.line(f"  {drag.name}, {drag.friction:g}"))
        print(inverted(drag))


def inverted(drag: Drag) -> str:
    """The shear model's answers to the drag's poses without noise, searched from the true place and load."""
    pad = standard_pad()
    response = ContactModel.load("shear", pad).response
    assert response is not None
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    truth = np.column_stack([drag.place_mm, drag.load_n])[drag.first :]
    change = drag.response[drag.first :] * [1e3, 1e3, 1e3, 1.0, 1.0]
    pose = upright(np.column_stack([solver.rest_pose[:5] + change, np.zeros(len(change))]))
    covariance = solver.at(pose).covariance
    found = truth.copy()
    refiner = Refiner(response)
    for number, start in enumerate(truth):
        found[number] = refiner.refined(start, change[number], covariance[number], STEPS)[0]
    shear, read = np.hypot(*truth[:, 3:].T), np.hypot(*found[:, 3:].T)
    slips = drag.way_mm[drag.first :] >= drag.slips_from_mm
    away = np.linalg.norm(found[:, :2] - truth[:, :2], axis=1)
    force, ratio = found[slips, 2] / truth[slips, 2] - 1.0, read[slips] / shear[slips] - 1.0
    return (
        f"    without noise, while it slips: force {force.min():+.0%} to {force.max():+.0%}, shear "
        f"{ratio.min():+.0%} to {ratio.max():+.0%}, place off by {away.min():.2f} to {away.max():.2f} mm"
    )


def healthy(options: Namespace, random: np.random.Generator) -> None:
    """Fingers that never slip, on a robot that stands or turns: false alarms a minute."""
    print(f"healthy fingers, {options.minutes:g} minutes of each")
    for kind in HEALTHY:
        false, seconds, pads = (
            0,
            0.0,
            {ambient: BuiltPad.of(config_of(ambient, 100 * options.seed)) for ambient in AMBIENTS},
        )
        while seconds < 60.0 * options.minutes:
            finger, pad = Healthy.drawn(random, kind), pads[AMBIENTS[int(seconds / 20.0) % 2]]
            source = (ToolNearby if kind == "tool" else ManyFrames)(pad.config)
            source.finger = finger
            told = np.array([message.slipping for message in messages(pad, source, finger.seconds)])
            false += int((told & ~np.append(False, told[:-1])).sum())
            seconds += finger.seconds
        print(f"  {kind:6} {false} in {seconds / 60.0:.1f} minutes: {60.0 * false / seconds:.2f} a minute")
