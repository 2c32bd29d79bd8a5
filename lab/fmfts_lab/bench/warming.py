"""A pad that warms while its chips' offsets drift: as much as is assumed, and several times as much.

No data sheet says what set and reset pulses leave of the drift (`Chip.offset_t_per_k`), so a chip may have more of it.
"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from fmfts.baseline import Baseline, BaselineError
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact import ContactModel
from fmfts.pipeline.configured import load_contact_model
from fmfts.sensor.frame import WireFrame
from fmfts_lab.bench.as_built import MISSED_N, RELEASE_S
from fmfts_lab.bench.built_world import Presses
from fmfts_lab.bench.drills import Ambient
from fmfts_lab.bench.silicone import Effect, RealPad, RealTruth, baseline_of, messages_of
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS
from fmfts_simulation.finger import Finger, no_finger

AMBIENTS: tuple[Ambient, ...] = ("constant", "drifting")
FINGERS = ("untouched", "pressed")


class WarmingPad(RealPad):
    """It warms by `most_k` within `seconds`."""

    most_k, seconds = 0.0, 1.0

    def drifts(self, times: float) -> None:
        """Let the offsets drift so many times as much as the chip's figure."""
        assert self._imperfections is not None
        self._imperfections.drift_times(times)


@dataclass(slots=True)
class Row:
    """The results of all pads with the same drift, in one scene."""

    t_per_k: float
    ambient: str
    fingers: str
    seed: int
    pads: int = 0
    refused: int = 0
    frames: int = 0
    health: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    least_published: float = 1.0  # of one pad
    wrong: int = 0
    worst_sd: float = 0.0
    rest_frames: int = 0
    false_frames: int = 0
    false_onsets: int = 0
    presses: int = 0  # above MISSED_N
    missed: int = 0

    def saw(self, told: Iterator[list[ContactMessage]], truth: RealTruth, finger: Finger) -> None:
        frames = published = 0
        was_touched, felt = False, None
        for messages in told:
            deviations = truth.all_deviations(messages)
            self.wrong += int((deviations > WRONG_DEVIATIONS).sum())
            self.worst_sd = max(self.worst_sd, float(deviations.max()))
            for message in messages:
                frames += 1
                published += message.health in PUBLISHED
                self.health[message.health] += 1
                if message.reason:
                    self.reasons[message.reason] += 1
                now_s = message.t_sample_ns * 1e-9
                force_n, touched = finger(now_s).force_n, message.contact is True
                if force_n == finger(now_s - RELEASE_S).force_n == 0.0:
                    self.rest_frames += 1
                    self.false_frames += touched
                    self.false_onsets += touched and not was_touched
                was_touched = touched
                if force_n > MISSED_N:
                    felt = bool(felt) or touched
                elif felt is not None:
                    self.presses += 1
                    self.missed += not felt
                    felt = None
        self.frames += frames
        self.least_published = min(self.least_published, published / frames)

    @property
    def line(self) -> str:
        published = sum(self.health[name] for name in PUBLISHED) / max(self.frames, 1)
        return (
            f"{self.t_per_k * 1e9:3.0f} nT/K {self.ambient:8} {self.fingers:9} published {published:7.2%} (one pad "
            f"{self.least_published:7.2%}), wrong {self.wrong} of {self.frames}, worst {self.worst_sd:.1f} sd, "
            f"false onsets {self.false_onsets}, frames {self.false_frames} of {self.rest_frames}, "
            f"missed {self.missed} of {self.presses}, refused {self.refused} of {self.pads}"
        )


def run(options: Namespace) -> None:
    rows = []
    for times in options.times:
        for ambient in options.scenes:
            for fingers in options.fingers:
                effect = Effect("offset drift", ("offset_drift",))
                config = effect.config(ambient, options.seed)
                row = Row(times * config.pad().chip.offset_t_per_k, ambient, fingers, options.seed)
                model = load_contact_model(config)
                for seed in range(options.seed, options.seed + options.pads):
                    trial(effect.config(ambient, seed), times, options, row, model)
                print(row.line, flush=True)
                for reason, count in row.reasons.most_common(3):
                    print(f"    {count} × {reason}")
                rows.append(row)
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(rows)) + b"\n")


def trial(config: PadConfig, times: float, options: Namespace, row: Row, model: ContactModel) -> None:
    row.pads += 1
    try:
        baseline: Baseline = baseline_of(config, RealPad(config), options.turn)
    except BaselineError:
        row.refused += 1
        return
    pipeline = without_baseline(config, model)
    pipeline.use(baseline)
    source = WarmingPad(config)
    source.drifts(times)
    source.most_k, source.seconds = options.kelvin, options.seconds
    assert isinstance(config.source, SimulatedSource)
    seed = config.source.seed
    finger: Finger = no_finger if row.fingers == "untouched" else Presses(np.random.default_rng(seed))
    source.finger = finger
    told = (messages_of(pipeline, frames) for frames in batches(source, options.seconds + options.after))
    row.saw(told, RealTruth(source, config, finger), finger)


def batches(source: WarmingPad, seconds: float) -> Iterator[list[WireFrame]]:
    """Even warming in steps of a second: some nanotesla."""
    for second in range(round(seconds)):
        source.warmed_k = source.most_k * min(second / source.seconds, 1.0)
        yield source.recorded(1.0)
