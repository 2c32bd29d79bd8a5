"""Faults, steel, turning and warm-up on a pad with four magnets: right, or said to be wrong; for `several --drills`."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.sensor import Frame
from fmfts.simulation.array import SimulatedArray
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import Finger, Touch, no_finger
from fmfts_lab.bench.tool_ways import Tool, Way
from fmfts_lab.finite_elements.array_model import array_config

RATE_HZ = 220
FAULT_S, MENDED_S, END_S = 1.0, 2.0, 3.0
WRONG = 5.0  # deviations
STEP_COUNTS = 60  # 4 µT: twenty deviations of the noise
Change = Callable[[Frame], Frame]


@dataclass(frozen=True, slots=True)
class Drill:
    """change: of the frames between FAULT_S and MENDED_S. tool_a_m2: of a magnet that passes at 60 mm, 0: none."""

    name: str
    change: Change | None = None
    tool_a_m2: float = 0.0
    turning_deg_per_s: float = 20.0
    warming_k_per_minute: float = 0.0
    seconds: float = END_S


@dataclass(slots=True)
class Counted:
    """Frames of one drill. wrong: told as good, and off by more than WRONG deviations. false: a finger that is none."""

    frames: int = 0
    good: int = 0
    silent: int = 0
    wrong: int = 0
    wrong_degraded: int = 0
    false: int = 0
    worst: float = 0.0


class BesideTool(SimulatedArray):
    """A simulated pad beside a magnetic tool."""

    tool: Tool | None = None

    def _ambient(self, sampled_s: Array) -> Array:
        own = super()._ambient(sampled_s)
        if self.tool is None:
            return own
        both: Array = own + self.tool.field_t(self._built.pad.sensors.position_m, sampled_s[None])[0]
        return both


def silent(sensor: int) -> Change:
    def changed(frame: Frame) -> Frame:
        valid = frame.valid.copy()
        valid[sensor] = False
        return replace(frame, valid=valid)

    return changed


def off(sensor: int, counts: int) -> Change:
    def changed(frame: Frame) -> Frame:
        moved = frame.counts.copy()
        moved[sensor] += np.array([counts, 0, -counts], dtype=np.int16)
        return replace(frame, counts=moved)

    return changed


def stuck(sensor: int) -> Change:
    kept: list[Array] = []

    def changed(frame: Frame) -> Frame:
        kept.append(frame.counts[sensor].copy())
        moved = frame.counts.copy()
        moved[sensor] = kept[0]
        return replace(frame, counts=moved)

    return changed


DRILLS = (
    Drill("healthy, turning at 20°/s"),
    Drill("healthy, turning at 90°/s", turning_deg_per_s=90.0),
    Drill("warming by 10 K a minute", warming_k_per_minute=10.0, seconds=20.0),
    *(Drill(f"sensor {one + 1} silent", silent(one)) for one in (0, 5)),
    *(Drill(f"sensor {one + 1} off by 4 µT", off(one, STEP_COUNTS)) for one in (0, 5)),
    *(Drill(f"sensor {one + 1} off by 40 µT", off(one, 10 * STEP_COUNTS)) for one in (0, 5)),
    *(Drill(f"sensor {one + 1} stuck", stuck(one)) for one in (0, 5)),
    *(
        Drill(f"a tool of {moment:g} A·m² passes at 60 mm", tool_a_m2=moment, seconds=4.0)
        for moment in (0.005, 0.05, 0.2)
    ),
)


def holding(time_s: float) -> Touch:
    return Touch(-6e-3, -1e-3, 0.8)


def other(time_s: float) -> Touch:
    return Touch(7e-3, 3e-3, 0.6)


FINGERS: dict[str, tuple[Finger, Finger | None]] = {
    "none": (no_finger, None),
    "one": (holding, None),
    "two": (holding, other),
}


def run(options: Namespace) -> None:
    print(
        "| drill | fingers | ok | contacts not told | wrong ok | wrong degraded | false fingers | worst, deviations |\n"
        "| --- | --- | --- | --- | --- | --- | --- | --- |"
    )
    for drill in DRILLS:
        if options.only and not any(drill.name.startswith(one) for one in options.only):
            continue
        for name, fingers in FINGERS.items():
            whole = Counted()
            for seed in range(options.seed, options.seed + options.pads):
                _drilled(whole, drill, fingers, seed)
            print(
                f"| {drill.name} | {name} | {whole.good / whole.frames:.1%} | {whole.silent / whole.frames:.1%} "
                f"| {whole.wrong} of {whole.frames} | {whole.wrong_degraded} | {whole.false} | {whole.worst:.1f} |",
                flush=True,
            )


def _drilled(whole: Counted, drill: Drill, fingers: tuple[Finger, Finger | None], seed: int) -> None:
    config = _config(drill, seed)
    pipeline = pipeline_of(config, contact_model_of(config), "drill")
    pipeline.use(simulated_baseline(_config(DRILLS[0], seed)))  # before it warms
    source = BesideTool(config)
    source.finger, source.second_finger = fingers
    if drill.tool_a_m2:
        random = np.random.default_rng((seed, 7))
        source.tool = Tool(Way("passes", 0.06, 0.3), drill.tool_a_m2, random)
    for frame in _frames(source, drill.seconds):
        time_s = frame.device_time_us * 1e-6
        if drill.change is not None and FAULT_S <= time_s < MENDED_S:
            frame = drill.change(frame)
        message = pipeline.process(frame)
        if time_s > 0.1:
            _judge(whole, message, [one(0.0) for one in fingers if one is not None and one is not no_finger])


def _config(drill: Drill, seed: int) -> PadConfig:
    config = array_config(seed=seed)
    assert isinstance(config.source, SimulatedSource)
    source = msgspec.structs.replace(
        config.source,
        turning_deg_per_s=drill.turning_deg_per_s,
        warming_k_per_minute=drill.warming_k_per_minute,
        finger="none",
    )
    return msgspec.structs.replace(config, source=source)


def _frames(source: SimulatedArray, seconds: float) -> Iterator[Frame]:
    for step in range(round(seconds * RATE_HZ)):
        yield from source.poll(step * round(1e9 / RATE_HZ))


def _judge(whole: Counted, message: ContactMessage, truth: list[Touch]) -> None:
    whole.frames += 1
    whole.good += message.health == "ok"
    if not isinstance(message.contacts, list):
        whole.silent += 1
        return
    off_by = _deviations(message, truth)
    whole.false += len(message.contacts) > len(truth)
    if message.health == "ok":
        whole.worst = max(whole.worst, off_by)
        whole.wrong += off_by > WRONG
    else:
        whole.wrong_degraded += off_by > WRONG


def _deviations(message: ContactMessage, truth: list[Touch]) -> float:
    """How far what is told is off, in its own deviations: of the resultant's force, and of each finger if as many are
    told as there are."""
    if message.force_n is None or message.force_sd_n is None:
        return 0.0
    worst = abs(message.force_n - sum(touch.force_n for touch in truth)) / message.force_sd_n
    contacts = message.contacts if isinstance(message.contacts, list) else []
    if len(contacts) != len(truth):
        return worst
    for told, true in zip(sorted(contacts, key=lambda one: one.x_m), sorted(truth), strict=True):
        each = (
            (told.x_m - true.x_m) / told.x_sd_m,
            (told.y_m - true.y_m) / told.y_sd_m,
            (told.force_n - true.force_n) / told.force_sd_n,
        )
        worst = max(worst, *map(abs, each))
    return worst
