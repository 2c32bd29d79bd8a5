"""Makes the frozen worlds from simulated pads: `python -m golden.make [NAME…]`, only to make a new world.

A world never changes: the frames in `data/` do not follow later changes of the simulation.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from fmfts.baseline import Baseline
from fmfts.baseline.request import BaselineRequest
from fmfts.config import (
    BridgeSource,
    ContactConfig,
    GeometryConfig,
    PadConfig,
    PlacementConfig,
    SceneConfig,
    SimulatedSource,
    ToleranceConfig,
)
from fmfts.pad import Array
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS
from fmfts_lab.bench.several_layouts import LAYOUTS
from fmfts_lab.bench.tool_ways import Tool, Way
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, MeetingFingers, ScriptedFinger, Touch, no_finger
from fmfts_simulation.source import Simulated
from golden.faults import Stream
from golden.world import FOLDER, World, WorldPad

RATE_HZ = 220
AS_DRAWN = ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0)
WHEN = "1970-01-01T00:00:00+00:00"
SOONER_S = 3.7  # the scripted finger does not touch a pad in its first 4 s


@dataclass(slots=True)
class Plan:
    """One pad of a world. noise: in multiples of the chip's. tools: objects near the pad. is_on_board: its samples come
    over a serial line, which makes them older."""

    config: PadConfig
    frames: int
    finger: Finger | None = None
    second: Finger | None = None
    noise: float = 1.0
    faults: list[list[Any]] = field(default_factory=list)
    tools: Sequence[Tool] = ()
    is_early: bool = False
    comes_again: bool = False
    turned: bool = False
    baseline: str = "rest"
    is_on_board: bool = False


def pad(seed: int, ambient: str = "drifting", turning: float = 0.0, name: str = "left", **other: Any) -> PadConfig:
    source = {key: other.pop(key) for key in ("finger_shape", "imperfections", "warming_k_per_minute", "range_gauss",
                                              "finger_friction", "publish") if key in other}  # fmt: skip
    scene = other.pop("scene", SceneConfig(ambient=ambient))  # type: ignore[arg-type]
    return PadConfig(
        name=name,
        source=SimulatedSource(seed=seed, rate_hz=RATE_HZ, turning_deg_per_s=turning, **source),
        scene=scene,
        **({"tolerance": AS_DRAWN} | other),
    )


def on_board(config: PadConfig) -> PadConfig:
    return replace(config, source=BridgeSource(port="/dev/null", rate_hz=RATE_HZ, publish=config.source.publish))


class Beside:
    """A tool, as a simulated pad takes its neighbours."""

    finger: Finger = staticmethod(no_finger)
    second_finger = None

    def __init__(self, tool: Tool) -> None:
        self._tool = tool

    def field(self, place_m: Array, sampled_s: Array, warming_k: float) -> Array:
        return self._tool.field_t(place_m, sampled_s[None])[0]


def baseline_of(plan: Plan, beside: Sequence[PadConfig]) -> Baseline | None:
    config = plan.config
    if plan.baseline == "none":
        return None
    baseline = simulated_baseline(config, beside)
    if plan.baseline == "bare":
        baseline = replace(baseline, rest=None).sealed()
    if plan.turned:
        request = BaselineRequest(config.pad(), config.tolerance.si(), False, False, turn=True)
        source = Simulated(config)
        source.finger, source.tumbling = no_finger, True
        frames = [one for step in range(round(request.seconds * RATE_HZ)) for one in source.poll(_time_ns(step))]
        baseline, _ = request.make(frames, baseline)
    recorded = {
        name: replace(one, utc=WHEN)
        for name in ("bare", "rest", "turn")
        if (one := getattr(baseline, name)) is not None and hasattr(one, "utc")
    }
    return replace(baseline, **recorded).sealed()


def _time_ns(step: int) -> int:
    return -(-step * 1_000_000_000 // RATE_HZ)


def made(name: str, *plans: Plan) -> World:
    configs = [plan.config for plan in plans]
    pads = []
    for number, plan in enumerate(plans):
        config = plan.config
        beside = [one for one in configs if one.name in config.scene.neighbours]
        source = (SimulatedArray if config.other_magnets else Simulated)(config, beside, noise_t=0.0)
        if plan.finger is not None:
            source.finger = plan.finger
        else:
            script = source.finger
            source.finger = lambda time_s, script=script: script(time_s + SOONER_S)  # type: ignore[misc]
        if plan.second is not None:
            source.second_finger = plan.second
        for each, other in zip(source.neighbours, beside, strict=True):
            fingers = [one.finger for one in plans if one.config.name == other.name]
            each.finger = fingers[0] or each.finger
        source.neighbours.extend(Beside(tool) for tool in plan.tools)  # type: ignore[misc]
        frames = [one for step in range(plan.frames) for one in source.poll(_time_ns(step))]
        chip = CHIPS[config.source.chip]
        step_t = float(np.asarray(chip.step_t[frames[0].gain_code]).ravel()[0])
        pads.append(
            world_pad(
                *(on_board(config) if plan.is_on_board else config, baseline_of(plan, beside), frames),
                noise=round(plan.noise * chip.noise_t / step_t * 1000),
                seed=len(name) * 1000 + sum(map(ord, name)) + 7919 * number,
                faults=plan.faults,
                is_early=plan.is_early,
                comes_again=plan.comes_again,
            )
        )
    return World(name, pads)


def world_pad(config: PadConfig, baseline: Baseline | None, frames: Sequence[Frame], **other: Any) -> WorldPad:
    told = sorted({one.temperature_c for one in frames if one.temperature_c is not None})
    stream = Stream(
        *(
            np.array([getattr(one, name) for one in frames], np.int64)
            for name in ("sequence", "device_time_us", "host_time_ns")
        ),
        *(
            np.array([getattr(one, name) for one in frames]).astype(np.int64)
            for name in ("counts", "age_us", "fresh", "valid")
        ),
        np.array([-1 if one.temperature_c is None else told.index(one.temperature_c) for one in frames], np.int64),
    )
    (gain_code,) = {one.gain_code for one in frames}
    kept = None if baseline is None else msgspec.to_builtins(baseline)
    return WorldPad(msgspec.to_builtins(config), kept, gain_code, told, stream, **other)


def sensor_faults(first: int, apart: int) -> list[list[Any]]:
    """Every kind of fault of a sensor, one after another, with healthy pauses of the same length."""
    kinds: list[list[Any]] = [
        ["offset", 1, 0, 120], ["stuck", 2, 1], ["saturated", 0, 2], ["silent", 3], ["spike", 2, 0, 150, 10],
        ["gain", 0, 2, 1050], ["offset", 3, 2, -20], ["old", 1, 3], ["lost", 7, 2], ["cold"], ["offset", 0, 1, 6],
        ["swapped", 0, 1], ["saturated", 1, 0], ["silent", 0], ["field", 40, -60, 30], ["gain", 2, 2, 980],
        ["stuck", 0, 0], ["gradient", 80, 0, 30, -20, 10, 0, 0, 5, -10, 10, 0, 60], ["lost", 50, 48],
        ["offset", 2, 2, 9],
    ]  # fmt: skip
    return [
        [kind, first + number * apart, first + number * apart + (2 * apart) // 3, *args]
        for number, (kind, *args) in enumerate(kinds)
    ]


class Later:
    """A tool that starts later, and is far away before."""

    def __init__(self, tool: Tool, later_s: float, until_s: float) -> None:
        self._tool, self._later_s, self._until_s = tool, later_s, until_s

    def field_t(self, places_m: Array, time_s: Array) -> Array:
        there = (time_s >= self._later_s) & (time_s < self._until_s)
        return self._tool.field_t(places_m, time_s - self._later_s) * there[..., None]


def passing(seed: int, seconds: float) -> list[Any]:
    """One tool after another, each coming from afar."""
    ways = (Way("passes", 0.045, 0.3), Way("passes", 0.09, 0.3), Way("put down", 0.06, 1.0), Way("turned", 0.1, 0.0),
            Way("passes", 0.045, 0.05), Way("put down", 0.15, 0.05))  # fmt: skip
    moments = (0.055, 0.2, 0.02, 0.055, 0.02, 0.2)
    found, begin_s = [], 0.0
    for number, (way, moment) in enumerate(zip(ways, moments, strict=True)):
        tool = Tool(way, moment, np.random.default_rng([seed, number]))
        found.append(Later(tool, begin_s, begin_s + way.seconds))
        begin_s += way.seconds
        if begin_s > seconds:
            break
    return found


def pair(ambient: str) -> tuple[PadConfig, PadConfig]:
    turning = 20.0 if ambient == "drifting" else 0.0
    beside = PlacementConfig(position_mm=(30.0, 0.0, 0.0), rotation_deg=(8.0, 0.0, 0.0))
    scenes = [SceneConfig(ambient=ambient, neighbours=(other,)) for other in ("second", "first")]  # type: ignore[arg-type]
    return (
        pad(21, turning=turning, name="first", scene=scenes[0], range_gauss=4.0),
        pad(1021, turning=turning, name="second", scene=scenes[1], range_gauss=4.0, placement=beside),
    )


def script(seed: int, later_s: float = 0.0, friction: float = 0.0) -> Finger:
    own = ScriptedFinger(seed, friction)
    return lambda time_s: own(time_s + SOONER_S - later_s)


def of_array(seed: int, name: str, turning: float, model: str = "default") -> PadConfig:
    config = LAYOUTS[name]
    assert isinstance(config.source, SimulatedSource)
    source = replace(config.source, seed=seed, rate_hz=RATE_HZ, turning_deg_per_s=turning)
    return replace(config, source=source, contact=ContactConfig(model=model))


def meeting(seed: int) -> tuple[Finger, Finger]:
    both = MeetingFingers(seed)
    return (lambda time_s: both.staying(time_s + SOONER_S)), (lambda time_s: both.coming(time_s + SOONER_S))


def sheared(time_s: float) -> Touch:
    """A press that leans one way and the other."""
    within = time_s % 2.0
    force_n = 1.2 * np.sin(np.pi * within / 1.6) ** 2 if within < 1.6 else 0.0
    lean = 0.4 * np.sin(2.0 * np.pi * time_s)
    return Touch(3e-3 * np.sin(time_s), -2e-3, float(force_n), float(lean * force_n), float(0.2 * force_n))


EIGHT = GeometryConfig(
    sensors_mm=((8, 8, 0), (8, -8, 0), (-8, 8, 0), (-8, -8, 0), (11, 0, 0), (-11, 0, 0), (0, 11, 0), (0, -11, 0))
)
IMPERFECT = ("silicone", "soft_iron", "offset_drift", "flicker", "nonlinear")
STEEL = SceneConfig(ambient="constant", steel_nearby=True)
WORLDS: dict[str, Callable[[], list[Plan]]] = {
    "healthy": lambda: [Plan(pad(3, turning=20.0, warming_k_per_minute=3.0), 30000)],
    "constant": lambda: [Plan(pad(4, "constant"), 20000)],
    "sheared": lambda: [Plan(pad(5, turning=5.0, finger_friction=0.3), 10000, finger=sheared)],
    "smoothed": lambda: [Plan(pad(6, contact=ContactConfig(refine=True, smoothing_ms=20.0)), 8000)],
    "noisy": lambda: [Plan(pad(7, turning=20.0), 12000, noise=5.0)],
    "imperfect": lambda: [Plan(imperfect(), 15000)],
    "faulty": lambda: [Plan(pad(9, turning=10.0), 14000, faults=sensor_faults(150, 150) + sensor_faults(4000, 480))],
    "faulty-constant": lambda: [
        Plan(pad(10, "constant"), 12000, faults=sensor_faults(150, 150) + sensor_faults(4000, 380))
    ],
    "eight-sensors": lambda: [Plan(pad(11, geometry=EIGHT), 8000, faults=FAULTS_OF_EIGHT)],
    "tools": lambda: [Plan(pad(12), 10000, tools=passing(12, 10000 / RATE_HZ))],
    "tools-constant": lambda: [Plan(pad(13, "constant"), 9000, tools=passing(13, 9000 / RATE_HZ))],
    "steel": lambda: [Plan(pad(14, scene=STEEL), 7000, tools=passing(14, 7000 / RATE_HZ))],
    "turning": lambda: [Plan(pad(15, turning=60.0), 12000)],
    "turned": lambda: [Plan(pad(16, turning=60.0), 8000, turned=True, tools=passing(16, 8000 / RATE_HZ))],
    "turning-constant": lambda: [Plan(pad(17, "constant", turning=20.0), 4000)],
    "neighbours": lambda: beside_each_other(pair("drifting"), 6000, ([], [])),
    "neighbours-constant": lambda: beside_each_other(
        pair("constant"), 3000, ([["offset", 400, 600, 1, 0, 100]], [["silent", 900, 1000, 2]])
    ),
    "samples": lambda: [
        Plan(pad(18, turning=20.0, publish="sample"), 9000, is_early=True, faults=FAULTS_BETWEEN_SAMPLES)
    ],
    "samples-on-board": lambda: [
        Plan(pad(27, turning=20.0, publish="sample"), 2500, is_early=True, is_on_board=True)
    ],
    "samples-again": lambda: [
        Plan(pad(35, turning=20.0, publish="sample"), 1500, is_early=True, comes_again=True, faults=JUMPS)
    ],
    "slightly-off": lambda: [Plan(pad(28, "constant"), 2500, faults=SLIGHT_FAULTS)],
    "fingers": lambda: [Plan(of_array(3, "4 over 8", 20.0), 9000, *meeting(3))],
    "fingers-faulty": lambda: [Plan(of_array(4, "4 over 8", 0.0), 5000, *meeting(4), faults=FAULTS_OF_FINGERS)],
    "poses": lambda: [
        Plan(of_array(5, "2 over 8", 20.0, "none"), 5000, *meeting(5), faults=[
            ["offset", 900, 1100, 4, 0, 200], ["silent", 1500, 1700, 1]])
    ],
    "without-model": lambda: [
        Plan(pad(19, turning=20.0, contact=ContactConfig(model="none")), 5000, faults=[
            ["offset", 900, 1100, 1, 0, 120]])
    ],
    "bare": lambda: [Plan(pad(20), 1500, baseline="bare")],
    "cold": lambda: [
        Plan(pad(25, warming_k_per_minute=30.0), 5000, faults=[
            ["cold", 0, 300], ["cold", 900, 2600], ["reset", 3000, 0]])
    ],
    "leaps": lambda: [Plan(pad(29, turning=10.0), 4500, faults=LEAPS)],
    "growing": lambda: [Plan(pad(30, "constant"), 3200, faults=GROWING_FAULTS)],
    "cooling": lambda: [
        Plan(pad(31, warming_k_per_minute=30.0), 2200, faults=[
            ["as warm", 700, 2200, 2100], ["as warm", 1000, 2200, 100], ["cold", 1400, 1500],
            ["as warm", 1700, 2200, 900]])
    ],
    "steel-faulty": lambda: [Plan(pad(32, scene=STEEL), 1500, faults=FAULTS_BESIDE_STEEL)],
    "lifted": lambda: [Plan(pad(33), 2500, tools=[Lifting(LIFTED_SLOWLY)])],
    "gradients": lambda: [Plan(pad(34), 2500, tools=[Gradient()])],
    "pulled": lambda: [Plan(pad(26), 3000, tools=[Lifting(LIFTED_AT_ONCE)])],
}  # fmt: skip
FAULTS_OF_EIGHT: list[list[Any]] = [
    ["offset", 300, 500, 5, 1, 60], ["silent", 600, 700, 7], ["gain", 1500, 3000, 2, 2, 1030],
    ["stuck", 4000, 4800, 0, 0],
]  # fmt: skip
EVERY_SENSOR = range(4)
# Of the board's clock alone; among lost frames; twice while no sample is new; while the computer is suspended.
LEAPS: list[list[Any]] = [
    ["leap", 300, 0, 1_000_000], ["leap", 500, 0, -2_000_000], ["leap", 700, 0, 10_000],
    ["lost", 900, 960, 1, 1], ["leap", 930, 0, 5_000_000], ["lost", 1200, 1290, 1, 1], ["leap", 1230, 0, -3_000_000],
    *(["old", 1500, 1503, sensor, 9999] for sensor in EVERY_SENSOR),
    ["leap", 1500, 0, 700_000], ["leap", 1501, 0, 400_000],
    ["lost", 1800, 1900, 1, 1], ["suspended", 1850, 0, 440_000_000], ["stands", 2200, 2300],
    *(["old", 2600, 2620, sensor, 9999] for sensor in EVERY_SENSOR), ["leap", 2610, 0, -900_000],
    ["leap", 3000, 0, 1 << 40], ["leap", 3001, 0, -(1 << 40)], ["leap", 3600, 0, -(1 << 21)],
]  # fmt: skip
# Too small to be found for certain: the deviations grow.
SLIGHT_FAULTS: list[list[Any]] = [
    ["offset", first, first + 250, sensor, axis, counts]
    for first, sensor, axis, counts in (
        (100, 1, 0, 2), (400, 1, 0, 3), (700, 2, 2, 2), (1000, 2, 2, 3), (1300, 0, 1, 2),
        (1600, 3, 0, 3), (1900, 3, 1, 4),
    )
]  # fmt: skip
# The mean residual suspects more than one sensor before single frames blame one; and counts that no chip can give.
GROWING_FAULTS: list[list[Any]] = [
    *(["offset", first + 60 * step, first + 60 * step + 60, sensor, axis, counts]
      for first, sensor, axis, sizes in (
          (100, 1, 0, (4, 6, 9, 14, 30)), (600, 2, 2, (4, 7, 12, 40)), (1000, 0, 1, (5, 40, 7)),
          (1400, 3, 2, (6, 10, 30)), (1800, 1, 1, (8, 14, 8, 100)))
      for step, counts in enumerate(sizes)),
    ["field", 3015, 3055, 71, -146, 41],
    ["gradient", 3015, 3055, -44, 37, -29, 42, -37, 17, 49, -39, -50, -22, -14, -1],
    ["offset", 2100, 2159, 3, 2, -11], ["offset", 2159, 2184, 3, 2, 66],
    ["untellable", 2300, 2400, 2, 1, 2600], ["untellable", 2500, 2600, 0, 0, -2700],
]  # fmt: skip
FAULTS_BESIDE_STEEL: list[list[Any]] = [
    ["silent", 200, 320, 1], ["offset", 400, 520, 2, 0, 120], ["stuck", 600, 720, 0, 1], ["saturated", 800, 920, 3, 2],
    ["offset", 1000, 1150, 1, 2, 8], ["silent", 1250, 1400, 3],
]  # fmt: skip
FAULTS_BETWEEN_SAMPLES: list[list[Any]] = [
    ["offset", 2500, 2700, 1, 0, 120], ["silent", 3000, 3300, 0], ["lost", 3600, 3900, 5, 1]
]  # fmt: skip
# Of one sample, too small to show among those of all sensors.
JUMPS: list[list[Any]] = [
    ["offset", 60 * number + 60, 60 * number + 90, number % 4, number % 3, 6 + number // 2] for number in range(22)
]
FAULTS_OF_FINGERS: list[list[Any]] = [
    ["offset", 700, 900, 5, 0, 270], ["silent", 1200, 1500, 2], ["saturated", 1700, 1900, 1, 2],
    ["stuck", 2200, 2600, 6, 1], ["gradient", 3000, 3200, *([60, -40, 20] + [0] * 21)], ["lost", 3500, 3700, 7, 2],
    ["spike", 4000, 4300, 3, 1, 200, 20],
]  # fmt: skip


def imperfect() -> PadConfig:
    return pad(
        *(8, "drifting", 20.0),
        imperfections=IMPERFECT,
        finger_shape="ball",
        tolerance=ToleranceConfig(),
        warming_k_per_minute=10.0,
    )


def beside_each_other(
    pads: tuple[PadConfig, PadConfig], frames: int, faults: tuple[list[Any], list[Any]]
) -> list[Plan]:
    """Each pad is pressed while the other rests, and both at once."""
    fingers = script(21), script(22, 3.7)
    return [Plan(one, frames, finger, faults=own) for one, finger, own in zip(pads, fingers, faults, strict=True)]


def skin() -> World:
    """A skin of unknown magnets over five sensors, by a table of noisy presses: fingers of 0 to 8 N."""
    from skin.skin_pad import SENSORS_MM, streamed_field
    from skin.test_skin_pipeline import MM_OF_A_NEWTON, NOISE_UT, config, response

    chip, count, rate_hz = CHIPS["mlx90393_streamed"], 6000, 100
    table = response("force_n").encoded()
    settings = config("skin.response")
    number = np.arange(count)
    slow = np.sin(2.0 * np.pi * number[:, None] / np.array([900.0, 1300.0]))
    force_n = np.maximum(0.0, 8.0 * np.sin(2.0 * np.pi * number / 500.0) ** 3)
    press = np.column_stack([8.0 * slow, force_n * MM_OF_A_NEWTON])
    ambient_ut = 40.0 * np.column_stack([np.sin(number / 400.0), np.cos(number / 400.0), 0.0 * number])

    def counts(press: Array, ambient_ut: Array) -> Any:
        field_t = (streamed_field(press).reshape(len(press), 5, 3) + ambient_ut[:, None]) * 1e-6
        return np.rint(field_t / np.asarray(chip.step_t[0])).astype(np.int64)

    def stream(counts: Any) -> Stream:
        rows = np.arange(len(counts))
        time_us = rows * (1_000_000 // rate_hz)
        zeros, ones = np.zeros((len(rows), 5), np.int64), np.ones((len(rows), 5), np.int64)
        return Stream(rows, time_us, time_us * 1000, counts, zeros, ones, ones.copy(), 0 * rows)

    thousandths = round(NOISE_UT * 1e-6 / float(np.asarray(chip.step_t[0]).ravel()[0]) * 1000)
    kept = msgspec.to_builtins(settings)
    resting = WorldPad(kept, None, 0, [25.0], stream(counts(np.zeros((200, 3)), np.zeros((200, 3)))), thousandths, 77)
    frames = [event for _, events in resting.events() for event in events if isinstance(event, Frame)]
    request = BaselineRequest(settings.pad(), settings.tolerance.si(), bare=False, replaced=False, duration_s=2.0)
    baseline, _ = request.make(frames, None)
    assert baseline.rest is not None
    baseline = replace(baseline, rest=replace(baseline.rest, utc=WHEN)).sealed()
    assert len(SENSORS_MM) == 5
    faults: list[list[Any]] = [
        ["silent", 700, 900, 2],
        ["offset", 1500, 1700, 1, 0, 3000],
        ["saturated", 2600, 2800, 3, 2],
    ]
    return World("skin", [WorldPad(kept, msgspec.to_builtins(baseline), 0, [25.0], stream(counts(press, ambient_ut)),
                                   thousandths, 78, faults, response=table)])  # fmt: skip


def recorded() -> World:
    """A recording of a daemon with two simulated pads: noise, times and all."""
    import tempfile
    from pathlib import Path

    from drills.same_numbers import made_on_the_spot
    from fmfts.bus.frame_message import frame_of
    from fmfts.bus.messages import FrameMessage, StateMessage
    from fmfts_recording.file import read

    with tempfile.TemporaryDirectory() as folder:
        path = made_on_the_spot(Path(folder) / "world.mcap", 12.0)
        states: dict[str, StateMessage] = {}
        frames: dict[str, list[Frame]] = {}
        for one in read(path):
            if isinstance(one.message, StateMessage):
                states.setdefault(one.pad, one.message)
            elif isinstance(one.message, FrameMessage) and one.message.used and one.pad in states:
                chip = CHIPS[msgspec.convert(states[one.pad].config, PadConfig).source.chip]
                frames.setdefault(one.pad, []).append(frame_of(one.message, chip=chip))
    pads = []
    for name, own in frames.items():
        assert states[name].baseline is not None
        config = msgspec.convert(states[name].config, PadConfig)
        pads.append(world_pad(config, msgspec.convert(states[name].baseline, Baseline), own))
    return World("recorded", pads)


OTHERS: dict[str, Callable[[], World]] = {"skin": skin, "recorded": recorded}


# Times in s, and the share of the magnet's field that is removed.
LIFTED_AT_ONCE = (
    (0.0, 1.499, 1.5, 3.5, 3.501, 5.0, 5.001, 5.299, 5.3),
    (0.0, 0.0, 0.08, 0.08, 0.0, 0.0, 0.05, 0.05, 0.0),
)
LIFTED_SLOWLY = (0.0, 1.0, 4.0, 5.0, 6.0, 7.0, 10.0), (0.0, 0.0, 0.03, 0.0, 0.0, 0.012, 0.0)


class Lifting:
    """A field that grows as the magnet's does when it is pulled up: a weaker field at all sensors."""

    def __init__(self, course: tuple[tuple[float, ...], tuple[float, ...]]) -> None:
        self._course = course

    def field_t(self, places_m: Array, time_s: Array) -> Array:
        share = -np.interp(time_s, *self._course)
        r = places_m - np.array([0.0, 0.0, 12e-3])
        square = np.sum(r * r, axis=-1, keepdims=True)
        moment = np.array([0.0, 0.0, 6.15e-10])
        along = np.sum(r * moment, axis=-1, keepdims=True)
        field_t: Array = share[..., None] * (3.0 * along * r / square - moment) / square**1.5
        return field_t


class Gradient:
    """Fields of a constant gradient, each stronger than the last: from objects that are near no sensor alone."""

    def field_t(self, places_m: Array, time_s: Array) -> Array:
        random = np.random.default_rng(34)
        total = np.zeros(np.broadcast_shapes(places_m.shape, (*np.shape(time_s), 1)))
        for number in range(12):
            gradient = np.triu(random.normal(size=(3, 3)))
            gradient += gradient.T
            gradient -= np.eye(3) * np.trace(gradient) / 3.0
            there = (time_s >= 0.8 + 0.8 * number) & (time_s < 1.4 + 0.8 * number)
            total = total + there[..., None] * 5e-4 * 1.35**number * (places_m @ gradient)
        return total


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for name in sys.argv[1:] or [*WORLDS, *OTHERS]:
        world = OTHERS[name]() if name in OTHERS else made(name, *WORLDS[name]())
        world.save()
        path = FOLDER / f"{name}.frames.xz"
        print(f"{path.name:32} {world.frames:6d} frames {path.stat().st_size:7d} bytes", flush=True)


if __name__ == "__main__":
    main()
