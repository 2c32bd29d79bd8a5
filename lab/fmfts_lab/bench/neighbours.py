"""Two pads side by side, each pressed by its own finger: errors with and without knowledge of the other pad."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, PlacementConfig, SceneConfig, SimulatedSource, neighbours_of
from fmfts.pipeline.configured import Pipeline, contact_model_of, feel_neighbours, pipeline_of
from fmfts_lab.bench.drills import AS_DRAWN, FRAME_NS, RATE_HZ, Ambient
from fmfts_lab.bench.truth import WRONG_DEVIATIONS, Truth
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import UNLOADED_AT_START_S, Finger, ScriptedFinger, Touch
from fmfts_simulation.source import Simulated

# The distances that are tried, by the magnets in the pads of a pair. Pads of four magnets are 40 mm wide.
DISTANCES_MM = {
    (1, 1): (20, 30, 60, 100, 200),
    (4, 1): (40, 60, 100),
    (4, 4): (40, 60, 100),
}
RANGE_GAUSS = {1: 4.0, 4: 8.1}
AMBIENTS: tuple[Ambient, ...] = ("constant", "drifting")
# The second pad is rolled against the first, like two fingertips. Its finger presses while the first pad's finger
# rests.
TURN_DEG = (8.0, 0.0, 0.0)
LATER_S = 3.7


@dataclass(slots=True)
class Outcome:
    """Results of both pads of a pair. errors: of published places and forces, in their published deviations. answers:
    for each frame the errors of x, y (mm) and force (N), NaN if none is published, and the true force."""

    frames: int = 0
    wrong: int = 0
    false_contacts: int = 0
    health: Counter[str] = field(default_factory=Counter)
    errors: list[float] = field(default_factory=list)
    answers: list[tuple[float, float, float, float]] = field(default_factory=list)

    @property
    def line(self) -> str:
        rms = float(np.sqrt(np.mean(np.square(self.errors)))) if self.errors else float("nan")
        return (
            f"{100 * self.health['ok'] / self.frames:7.2f} {rms:8.2f} {max(self.errors, default=0.0):7.1f} "
            f"{self.wrong:6d} {self.false_contacts:6d}"
        )


def pair(
    distance_mm: float, ambient: Ambient, seed: int, magnets: tuple[int, int] = (1, 1)
) -> tuple[PadConfig, PadConfig]:
    """Two pads that name each other, of 1 or 4 magnets. At 20 mm their fields add up to more than the usual ±2.5 G."""

    def pad(name: str, other: str, seed: int, count: int, placement: PlacementConfig) -> PadConfig:
        turning = 20.0 if ambient == "drifting" else 0.0
        source = SimulatedSource(seed=seed, range_gauss=RANGE_GAUSS[count], finger="none", turning_deg_per_s=turning)
        return msgspec.structs.replace(
            PadConfig(name=name, source=source) if count == 1 else array_config(),
            name=name,
            source=source,
            tolerance=AS_DRAWN,
            scene=SceneConfig(ambient=ambient, neighbours=(other,)),
            placement=placement,
        )

    beside, (first, second) = PlacementConfig(position_mm=(distance_mm, 0.0, 0.0), rotation_deg=TURN_DEG), magnets
    return pad("first", "second", seed, first, PlacementConfig()), pad("second", "first", seed + 1000, second, beside)


def pressed_pair(pads: tuple[PadConfig, PadConfig], told: bool, seconds: float) -> Outcome:
    """Run both pads in step. told: whether each takes the other's magnets into account."""
    fingers = {pads[0].name: _later(pads[0], 0.0), pads[1].name: _later(pads[1], LATER_S)}
    sources = {pad.name: source_of(pad, pads, fingers) for pad in pads}
    pipelines = {pad.name: _pipeline(pad, pads) for pad in pads}
    if told:
        for pad in pads:
            feel_neighbours(pad, pads, pipelines)
    truths = {name: Truth(source.built, fingers[name]) for name, source in sources.items()}
    touched: dict[str, bool | None] = dict.fromkeys(fingers)
    outcome = Outcome()
    for message in _messages(sources, pipelines, seconds):
        truth = truths[message.pad]
        outcome.frames += 1
        outcome.health[message.health] += 1
        outcome.wrong += truth.deviations(message) > WRONG_DEVIATIONS
        touch = fingers[message.pad](message.t_sample_ns * 1e-9)
        fresh = message.contact is True and touched[message.pad] is not True
        outcome.false_contacts += fresh and touch.force_n == 0.0
        touched[message.pad] = message.contact
        error = np.nan, np.nan, np.nan
        if message.x_m is not None and message.y_m is not None and message.force_n is not None:
            outcome.errors += truth.contact_errors(message)
            away_mm = (message.x_m - touch.x_m) * 1e3, (message.y_m - touch.y_m) * 1e3
            error = *away_mm, message.force_n - touch.force_n
        outcome.answers.append((*error, touch.force_n))
    return outcome


def _messages(
    sources: dict[str, Simulated], pipelines: dict[str, Pipeline], seconds: float
) -> Iterator[ContactMessage]:
    for step in range(round(seconds * RATE_HZ)):
        for name, source in sources.items():
            for frame in source.poll(step * FRAME_NS):
                yield pipelines[name].process(frame)


def _later(pad: PadConfig, later_s: float) -> Finger:
    finger = ScriptedFinger(pad.source.seed if isinstance(pad.source, SimulatedSource) else 0)

    def touch(time_s: float) -> Touch:
        return finger(time_s + UNLOADED_AT_START_S - 0.5 - later_s)

    return touch


def source_of(pad: PadConfig, pads: tuple[PadConfig, PadConfig], fingers: dict[str, Finger]) -> Simulated:
    """The pad, and the magnets of its neighbours, each pressed by its finger."""
    others = neighbours_of(pad, pads)
    source = simulated_pad(pad, others)
    source.finger = fingers[pad.name]
    for other, magnet in zip(others, source.neighbours, strict=True):
        magnet.finger = fingers[other.name]
    return source


def _pipeline(pad: PadConfig, pads: tuple[PadConfig, PadConfig]) -> Pipeline:
    pipeline = pipeline_of(pad, contact_model_of(pad), "bench")
    pipeline.use(simulated_baseline(pad, neighbours_of(pad, pads)))
    return pipeline


def run(options: Namespace) -> None:
    """Print the table."""
    print(f"two pads, both pressed, {options.seconds:g} s each; errors of place and force in published deviations\n")
    print("magnets  distance  scene     neighbour   ok %   rms sd   worst  wrong  false contacts")
    for magnets, distances_mm in DISTANCES_MM.items():
        if options.magnets and "+".join(map(str, magnets)) not in options.magnets:
            continue
        for ambient in options.scenes:
            for distance_mm in distances_mm:
                for told in (False, True):
                    pads = pair(distance_mm, ambient, options.seed, magnets)
                    outcome = pressed_pair(pads, told, options.seconds)
                    print(
                        f"{magnets[0]} + {magnets[1]} {distance_mm:7d} mm  {ambient:9} "
                        f"{'told' if told else 'not told':9} {outcome.line}",
                        flush=True,
                    )
