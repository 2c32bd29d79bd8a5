"""A magnetic tool beside a pad: the field of a foreign dipole on many ways, of a pad at rest, pressed and tapped."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Literal

import msgspec
import numpy as np

from fmfts.baseline import Baseline
from fmfts.baseline.request import BaselineRequest
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts_lab.bench.drills import AS_DRAWN, RATE_HZ, live_finger
from fmfts_lab.bench.tapped import ManyFrames, tapping, without_baseline
from fmfts_lab.bench.tool_ways import BEGIN_S, WAYS, Tool, Way
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS, Truth
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, no_finger

Scene = Literal["still", "turning", "turned", "constant", "steel"]
SCENES: tuple[Scene, ...] = ("still", "turning", "turned", "constant", "steel")
MOMENTS_A_M2 = (0.005, 0.02, 0.055, 0.2)
Built = Literal["drawn", "machine", "hand"]
# Chips as drawn and self-tested; chips that a machine placed, and a hand, not self-tested.
BUILT: dict[Built, ToleranceConfig] = {
    "drawn": AS_DRAWN,
    "machine": ToleranceConfig(sensor_rotation_deg=0.5, cross_axis=0.002),
    "hand": ToleranceConfig(),
}
FINGERS: dict[str, Finger] = {"rest": no_finger, "pressed": live_finger, "tapped": tapping}
TURNING_DEG_PER_S = 30.0
RELEASE_S = 0.2
# A published force is wrong if it misses the true one by OFF_N, after the true one was constant within STEADY_N for a
# while.
OFF_N, STEADY_N, STEADY_S = 0.2, 0.02, (-0.1, -0.02, 0.0, 0.02)


class BesideTool(ManyFrames):
    """A simulated pad beside a tool."""

    def __init__(self, config: PadConfig, tool: Tool) -> None:
        super().__init__(config)
        self._tool = tool

    def _ambients(self, sampled_s: Array) -> Array:
        return super()._ambients(sampled_s) + self._tool.field_t(self._built.pad.sensors.position_m, sampled_s)


@dataclass(slots=True)
class Cell:
    """The results of one scene, moment, way and touch, over all pads, from BEGIN_S on.

    wrong, wrong_degraded: frames that are published `ok` and `degraded` with an error of more than WRONG_DEVIATIONS.
    false_contacts: frames that report a contact while nothing touches. off: see `_is_off`.
    """

    scene: str
    moment_a_m2: float
    way: str
    touch: str
    frames: int = 0
    health: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    wrong_degraded: int = 0
    worst: float = 0.0
    false_contacts: int = 0
    off: int = 0

    @property
    def line(self) -> str:
        shares = " ".join(f"{self.health[name] / self.frames:7.2%}" for name in ("ok", "degraded", "disturbed", "lost"))
        return (
            f"{self.scene:8} {self.moment_a_m2:5.3f} A·m² {self.way:28} {self.touch:7} {self.frames:7d} "
            f"{self.wrong:5d} {self.wrong_degraded:5d} {self.worst:8.1f} {self.false_contacts:6d} {self.off:5d}  "
            f"{shares}"
        )

    def saw(self, messages: Sequence[ContactMessage], truth: Truth, finger: Finger) -> None:
        deviations = truth.all_deviations(messages)
        for message, off in zip(messages, deviations.tolist(), strict=True):
            time_s = message.t_sample_ns * 1e-9
            if time_s < BEGIN_S:
                continue
            self.frames += 1
            self.health[message.health] += 1
            self.wrong += message.health == "ok" and off > WRONG_DEVIATIONS
            self.wrong_degraded += message.health == "degraded" and off > WRONG_DEVIATIONS
            if message.health in PUBLISHED:
                self.worst = max(self.worst, off)
                self.false_contacts += message.contact is True and _untouched(finger, time_s)
                self.off += message.health == "ok" and _is_off(message, finger, time_s)

    def add(self, other: Cell) -> None:
        self.frames += other.frames
        self.health += other.health
        self.wrong += other.wrong
        self.wrong_degraded += other.wrong_degraded
        self.worst = max(self.worst, other.worst)
        self.false_contacts += other.false_contacts
        self.off += other.off


def _untouched(finger: Finger, time_s: float) -> bool:
    """Whether nothing touched the pad for longer than a contact may outlast its touch."""
    return all(finger(time_s - ago_s).force_n == 0.0 for ago_s in np.linspace(0.0, RELEASE_S, 11).tolist())


def _is_off(message: ContactMessage, finger: Finger, time_s: float) -> bool:
    """Whether the published force misleads a controller that ignores deviations."""
    told_n = 0.0 if message.contact is False else message.force_n
    steady_n = [finger(time_s + around_s).force_n for around_s in STEADY_S]
    if told_n is None or message.over_range or max(steady_n) - min(steady_n) > STEADY_N:
        return False
    return abs(told_n - finger(time_s).force_n) > OFF_N


HEADER = (
    "                                                              frames wrong     worst  false    off\n"
    "scene    moment      way                          touch           ok degr.        sd contact 0.2 N  "
    "     ok degraded disturbed   lost"
)


def pad_config(scene: Scene, seed: int, built: Built, model: str = "default") -> PadConfig:
    """What the scene says, and what the robot does.

    still, turning: a drifting field; turned: the robot turns, also for `baseline --turn`. constant: nothing moves,
    which is not true; steel: the same, but for steel nearby, which is.
    """
    turning = TURNING_DEG_PER_S if scene in ("turning", "turned") else 0.0
    constant = scene in ("constant", "steel")
    return PadConfig(
        name="tool",
        source=SimulatedSource(seed=seed, finger="none", turning_deg_per_s=turning),
        tolerance=BUILT[built],
        scene=SceneConfig(ambient="constant" if constant else "drifting", steel_nearby=scene == "steel"),
        contact=ContactConfig(model=model),
    )


def baseline_of(config: PadConfig, scene: Scene) -> Baseline:
    """The baseline as recorded without a tool."""
    baseline = simulated_baseline(config)
    if scene == "turned":
        request = BaselineRequest(config.pad(), config.tolerance.si(), False, False, turn=True)
        source = ManyFrames(config)
        source.tumbling = True
        frames = [frame for batch in source.batches(round(request.seconds * RATE_HZ)) for frame in batch]
        baseline, _ = request.make(frames, baseline)
    return baseline


def messages_beside(
    config: PadConfig, baseline: Baseline, tool: Tool, finger: Finger, seconds: float, model: ContactModel
) -> tuple[list[ContactMessage], Truth]:
    """A pad's messages while the tool moves beside it."""
    pipeline, source = without_baseline(config, model), BesideTool(config, tool)
    pipeline.use(baseline)
    source.finger = finger
    answers = [pipeline.answer(frame) for batch in source.batches(round(seconds * RATE_HZ)) for frame in batch]
    messages = [message_of(answer) for answer in answers]
    return messages, Truth(source.built, finger)


def drilled(
    scenes: Sequence[Scene],
    moments_a_m2: Sequence[float],
    ways: Sequence[Way],
    touches: Sequence[str],
    seeds: range,
    built: Built,
    name: str = "default",
) -> Iterator[Cell]:
    """Every tool on every way, on each pad."""
    for scene in scenes:
        configs = {seed: pad_config(scene, seed, built, name) for seed in seeds}
        baselines = {seed: baseline_of(config, scene) for seed, config in configs.items()}
        model = load_contact_model(configs[seeds[0]])
        for moment_a_m2, way, touch in product(moments_a_m2, ways, touches):
            cell, finger = Cell(scene, moment_a_m2, way.label, touch), FINGERS[touch]
            for seed, config in configs.items():
                random = np.random.default_rng([seed, WAYS.index(way), round(moment_a_m2 * 1e6)])
                tool = Tool(way, moment_a_m2, random)
                cell.saw(*messages_beside(config, baselines[seed], tool, finger, way.seconds, model), finger)
            yield cell


def run(options: Namespace) -> None:
    """Print a row for each moment and touch, and for each way if `options.verbose`."""
    cells: list[Cell] = []
    sums: dict[tuple[str, float, str], Cell] = {}
    print(HEADER, flush=True)
    seeds = range(options.seed, options.seed + options.pads)
    given = options.scenes, options.moments, WAYS, options.touches, seeds, options.built, options.model
    for cell in drilled(*given):
        cells.append(cell)
        if options.verbose:
            print(cell.line, flush=True)
        key = cell.scene, cell.moment_a_m2, cell.touch
        sums.setdefault(key, Cell(cell.scene, cell.moment_a_m2, "all ways", cell.touch)).add(cell)
    print(*(row.line for row in sums.values()), sep="\n", flush=True)
    if options.out is not None:
        kept = cells if options.verbose else sums.values()
        facts = [{"seed": options.seed} | asdict(cell) | {"health": dict(cell.health)} for cell in kept]
        options.out.write_bytes(msgspec.json.format(msgspec.json.encode(facts)) + b"\n")
