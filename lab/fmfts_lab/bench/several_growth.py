"""How the time of a frame grows with magnets, sensors and fingers: from a frame to the bytes of its message.

All pads take turns, some frames each, so that the ratios hold on a computer that does other work, too. It is the
processor's time. The first frames of a turn, whose code is not in the caches yet, do not count.
"""

from __future__ import annotations

import time
from argparse import Namespace
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from fmfts.bus.encoding import encode
from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact.array_model import ARRAY_PATH, ArrayModel
from fmfts.pipeline.configured import Pipeline, contact_model_of, pipeline_of
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.sensor import Frame
from fmfts_lab.bench.drills import pad_config
from fmfts_lab.bench.several_growth_chart import draw
from fmfts_lab.bench.several_layouts import LAYOUTS, STANDARD
from fmfts_lab.bench.several_world import response_of
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, no_finger, steady_finger

RATE_HZ, WARM_FRAMES, PADS = 220, 40, 16
TURN_FRAMES, COLD_FRAMES = 25, 3
ONE, OTHER = steady_finger(3e-3, -4e-3, 1.0), steady_finger(8e-3, 7e-3, 0.7)
FINGERS: dict[str, tuple[Finger, Finger | None]] = {
    "untouched": (no_finger, None),
    "one finger": (ONE, None),
    "two fingers": (ONE, OTHER),
    "search": (ONE, OTHER),
}
# Two or three magnets do not distinguish two fingers at most places.
TWO_FINGERS = {"4 over 8", "4 over 12", "4 over 16"}
GOALS_US = {"untouched": 40.0, "one finger": 80.0, "two fingers": 150.0, "search": 2000.0}


@dataclass(slots=True)
class Case:
    """A pad under some fingers. is_search: each frame is the first one that the pad sees."""

    pipeline: Pipeline
    frames: list[Frame]
    is_search: bool
    times_s: list[float] = field(default_factory=list)

    @classmethod
    def of(cls, config: PadConfig, fingers: str, frames: int) -> Case:
        assert isinstance(config.source, SimulatedSource)
        config = msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, finger="none"))
        model = contact_model_of(config)
        if config.other_magnets:  # the shipped table is for all four alone; each moves as if the others were not there
            model = replace(ArrayModel.load(ARRAY_PATH, STANDARD.pad()), response=response_of(config.pad()))
        pipeline, source = pipeline_of(config, model, "growth"), simulated_pad(config)
        pipeline.use(simulated_baseline(config))
        source.finger, source.second_finger = FINGERS[fingers]
        made: list[Frame] = []
        step = 0
        while len(made) < WARM_FRAMES + frames:
            made.extend(source.poll(round(step * 1e9 / RATE_HZ)))
            step += 1
        case = cls(pipeline, made[WARM_FRAMES:], fingers == "search")
        for frame in made[:WARM_FRAMES]:
            answer = pipeline.answer(frame)
        message = answer.message if isinstance(answer, EncodedMessage) else answer
        assert message.health == "ok", f"{fingers}: {message.reason}"
        return case

    def take(self, number: int, counts: bool) -> None:
        if self.is_search:
            self.pipeline.start_anew()
        begun = time.process_time()
        answer = self.pipeline.answer(self.frames[number])
        if not isinstance(answer, EncodedMessage):
            encode(answer)
        if counts:
            self.times_s.append(time.process_time() - begun)

    @property
    def us(self) -> float:
        return float(np.median(self.times_s)) * 1e6


def run(options: Namespace) -> None:
    pads = {
        "1 over 4": pad_config("drifting", options.seed),
        **{name: LAYOUTS[name] for name in sorted(LAYOUTS, key=_size)},
    }
    cases: dict[tuple[str, str], Case] = {}
    for pad, config in pads.items():
        for fingers in FINGERS:
            if fingers in ("untouched", "one finger") or pad in TWO_FINGERS:
                cases[pad, fingers] = Case.of(config, fingers, options.repeats)
    for first in range(0, options.repeats, TURN_FRAMES):
        for case in cases.values():
            for number in range(first, min(first + TURN_FRAMES, options.repeats)):
                case.take(number, counts=number - first >= COLD_FRAMES)
    found = {key: case.us for key, case in cases.items()}
    print("| magnets over sensors | " + " | ".join(f"{one}, µs" for one in FINGERS) + " |")
    print("|" + " --- |" * (1 + len(FINGERS)))
    for pad in pads:
        told = (f"{found[pad, fingers]:.0f}" if (pad, fingers) in found else "" for fingers in FINGERS)
        print(f"| {pad} | " + " | ".join(told) + " |")
    print("| goal for 4 over 8 | " + " | ".join(f"{goal:.0f}" for goal in GOALS_US.values()) + " |")
    for fingers in ("untouched", "one finger"):
        ratio = found["4 over 8", fingers] / found["1 over 4", fingers]
        print(f"\n4 over 8 takes {ratio:.1f} times 1 over 4, {fingers}")
    for other in ("one finger", "two fingers"):
        mean_us = (found["4 over 8", "untouched"] + found["4 over 8", other]) / 2.0
        share = PADS * RATE_HZ * mean_us * 1e-6
        print(f"\n{PADS} pads of 4 over 8 at {RATE_HZ} Hz, every other one with {other}: {share:.0%} of a core")
    if options.chart:
        draw(found, GOALS_US, options.chart)


def _size(name: str) -> tuple[int, int]:
    """Magnets and sensors."""
    magnets, sensors = name.split(" over ")
    return int(magnets), int(sensors)
