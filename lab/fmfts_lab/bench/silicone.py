"""Effects of real pads that no tolerance names, one at a time: is the daemon right, or does it flag the error?"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.request import BaselineRequest
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, Imperfection, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor.frame import Frame, WireFrame
from fmfts_lab.bench.built_world import Presses
from fmfts_lab.bench.drills import RATE_HZ, Ambient
from fmfts_lab.bench.tapped import ManyFrames, without_baseline
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS, Truth
from fmfts_simulation.finger import Finger, Touch, no_finger
from fmfts_simulation.finger_shape import SHAPES
from fmfts_simulation.imperfections import Imperfections
from fmfts_simulation.mounted import MountedPad
from fmfts_simulation.silicone import CREEP_PER_DECADE, Silicone
from fmfts_simulation.source import Simulated

Shape = Literal["round", "ball", "edge", "flat", "angled", "thimble"]
RELEASED_S = 0.2  # see as_built.RELEASE_S


@dataclass(frozen=True, slots=True)
class Effect:
    """One row: the pad's effect, and its owner's configuration."""

    name: str
    imperfections: tuple[Imperfection, ...] = ()
    shape: Shape = "round"
    warming_k_per_minute: float = 0.0
    cast_is_named: bool = False
    friction: float = 0.0

    def config(self, ambient: Ambient, seed: int) -> PadConfig:
        named = {"magnet_position_mm": 1.0, "magnet_tilt_deg": 5.0} if self.cast_is_named else {}
        return PadConfig(
            name="real",
            source=SimulatedSource(
                seed=seed,
                finger="none",
                turning_deg_per_s=20.0 if ambient == "drifting" else 0.0,
                imperfections=self.imperfections,
                finger_shape=self.shape,
                warming_k_per_minute=self.warming_k_per_minute,
            ),
            tolerance=ToleranceConfig(gain=0.005, **named),
            scene=SceneConfig(ambient=ambient),
            contact=ContactConfig(friction=self.friction),
        )


EFFECTS = (
    Effect("none"),
    Effect("silicone", ("silicone",)),
    Effect("casting, unnamed", ("casting",)),
    Effect("casting, named", ("casting",), cast_is_named=True),
    Effect("soft iron", ("soft_iron",)),
    Effect("offset drift, 15 K", ("offset_drift",), warming_k_per_minute=30.0),
    Effect("disturbed chip", ("disturbed",)),
    Effect("flicker noise", ("flicker",)),
    Effect("steps", ("steps",)),
    Effect("nonlinear", ("nonlinear",)),
    Effect("bit errors", ("bit_errors",)),
    Effect("ball", shape="ball", friction=0.3),
    Effect("edge", shape="edge", friction=0.3),
    Effect("flat", shape="flat", friction=0.3),
    Effect("angled", shape="angled", friction=0.3),
    Effect("thimble", shape="thimble", friction=0.3),
)


class RealPad(ManyFrames):
    """A simulated pad with imperfections, many frames at once."""

    def __init__(self, config: PadConfig, noise_t: float | None = None) -> None:
        """noise_t: of a sample; None: the chip's."""
        super().__init__(config, noise_t=noise_t)
        if self._imperfections is None:
            shape, random = SHAPES["round"], np.random.default_rng(0)
            self._imperfections = Imperfections((), shape, self.built, RATE_HZ, random)

    def stands(self, built: MountedPad) -> None:
        """Replaces the pad by this one from now on."""
        self._built = built

    def creep_times(self, factor: float) -> None:
        """Let the silicone creep so many times as much."""
        assert self._imperfections is not None
        self._imperfections.silicone = Silicone(len(self.built.pad.sensors), factor * CREEP_PER_DECADE)

    def recorded(self, seconds: float) -> list[WireFrame]:
        """The next frames, in one go."""
        first = self._sequence
        return [frame for batch in self.batches(first + round(seconds * RATE_HZ)) for frame in batch]


class RealTruth(Truth):
    """The truth of a pad whose magnet creeps: it follows the times of the messages, which must come in order."""

    def __init__(self, source: Simulated, config: PadConfig, finger: Finger) -> None:
        assert isinstance(config.source, SimulatedSource)
        super().__init__(source.built, finger)
        shape, seeded = SHAPES[config.source.finger_shape], np.random.default_rng(0)
        self._imperfections = Imperfections(config.source.imperfections, shape, source.built, RATE_HZ, seeded)

    def poses(self, times_s: Sequence[float], touches: Sequence[Touch]) -> tuple[Array, Array]:
        count = len(self._built.pad.sensors)
        every = [touch for touch in touches for _ in range(count)]
        position_m, axis = self._imperfections.pose(self._built, every, np.tile(np.array(times_s)[:, None], (1, count)))
        return position_m[:, 0], axis[:, 0]


@dataclass(slots=True)
class Row:
    """The results of one effect in one scene, over all pads."""

    effect: str
    ambient: str
    seed: int
    pads: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    frames: int = 0
    health: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    wrong_contacts: int = 0
    worst: float = 0.0
    rest_frames: int = 0
    false_contacts: int = 0
    longest_false_s: float = 0.0
    errors: list[float] = field(default_factory=list)
    off_m: list[float] = field(default_factory=list)
    off_n: list[float] = field(default_factory=list)

    def saw(self, messages: Sequence[ContactMessage], truth: Truth, finger: Finger) -> None:
        deviations = truth.all_deviations(messages)
        self.frames += len(messages)
        self.wrong += int((deviations > WRONG_DEVIATIONS).sum())
        self.worst = max(self.worst, float(deviations.max()))
        since_s: float | None = None
        for message in messages:
            self.health[message.health] += 1
            if message.reason:
                self.reasons[message.reason] += 1
            now_s = message.t_sample_ns * 1e-9
            touch = finger(now_s)
            untouched = touch.force_n == 0.0
            if message.contact is True and untouched:
                since_s = now_s if since_s is None else since_s
                self.longest_false_s = max(self.longest_false_s, now_s - since_s)
            else:
                since_s = None
            if untouched and finger(now_s - RELEASED_S).force_n == 0.0:
                self.rest_frames += 1
                self.false_contacts += message.contact is True
            if message.health not in PUBLISHED:
                continue
            errors = truth.contact_errors(message)
            self.wrong_contacts += max(errors, default=0.0) > WRONG_DEVIATIONS
            if message.x_m is not None and message.y_m is not None and message.force_n is not None:
                self.errors += errors
                self.off_m += [abs(message.x_m - touch.x_m), abs(message.y_m - touch.y_m)]
                self.off_n.append(abs(message.force_n - touch.force_n))

    @property
    def line(self) -> str:
        head = f"{self.effect:20} {self.ambient:8} "
        if not self.frames:
            return head + f"refused {self.refused.total()} of {self.pads}"
        published = sum(self.health[name] for name in PUBLISHED) / self.frames
        within = np.mean(np.array(self.errors) <= 2.0) if self.errors else np.nan
        error = f"{np.mean(self.off_m) * 1e3:.3f} mm {np.mean(self.off_n):.4f} N" if self.off_n else "no contact"
        return (
            f"{head}ok {self.health['ok'] / self.frames:7.2%} published {published:7.2%} "
            f"wrong {self.wrong:5d} ({self.wrong_contacts} contacts) of {self.frames}, worst {self.worst:5.1f} sd, "
            f"within 2 sd {within:6.2%}, {error}, false contact {self.false_contacts / max(self.rest_frames, 1):.2%}, "
            f"longest {self.longest_false_s:.2f} s, refused {self.refused.total()}"
        )

    @property
    def facts(self) -> dict[str, object]:
        return {
            "seed": self.seed,
            "effect": self.effect,
            "ambient": self.ambient,
            "pads": self.pads,
            "refused": dict(self.refused),
            "frames": self.frames,
            "health": dict(self.health),
            "reasons": dict(self.reasons.most_common(5)),
            "wrong": self.wrong,
            "worst_sd": self.worst,
            "within_2_sd": float(np.mean(np.array(self.errors) <= 2.0)) if self.errors else None,
            "place_error_m": float(np.mean(self.off_m)) if self.off_m else None,
            "force_error_n": float(np.mean(self.off_n)) if self.off_n else None,
            "rest_frames": self.rest_frames,
            "false_contact_frames": self.false_contacts,
            "longest_false_s": self.longest_false_s,
        }


def baseline_of(config: PadConfig, source: RealPad, turn: bool) -> Baseline:
    """Bare, rest and, if `turn`, the robot turned; BaselineError if one of them is refused."""
    before: Baseline | None = None
    source.finger, turning_rad_per_s = no_finger, source.turning_rad_per_s
    source.turning_rad_per_s = 0.0
    for bare, tumbling in ((True, False), (False, False), *([(False, True)] if turn else [])):
        request = BaselineRequest(config.pad(), config.tolerance.si(), bare, False, turn=tumbling)
        source.mounted, source.tumbling = not bare, tumbling
        before = request.make(source.recorded(request.seconds), before)[0]
    source.tumbling, source.turning_rad_per_s = False, turning_rad_per_s
    assert before is not None
    return before


def trial(
    effect: Effect, ambient: Ambient, seed: int, seconds: float, turn: bool, row: Row, model: ContactModel
) -> None:
    config = effect.config(ambient, seed)
    row.pads += 1
    try:
        baseline = baseline_of(config, RealPad(config), turn)
    except BaselineError as error:
        row.refused[str(error).split(" off. ", 1)[-1]] += 1
        return
    pipeline = without_baseline(config, model)
    pipeline.use(baseline)
    source = RealPad(config)
    finger = Presses(np.random.default_rng(seed))
    source.finger = finger
    messages = messages_of(pipeline, frames_of(source, config, seconds))
    row.saw(messages, RealTruth(source, config, finger), finger)


def frames_of(source: RealPad, config: PadConfig, seconds: float) -> Sequence[Frame | WireFrame]:
    """The next frames. Where the pad warms, polled one by one."""
    if not (isinstance(config.source, SimulatedSource) and config.source.warming_k_per_minute):
        return source.recorded(seconds)
    return [frame for _ in range(round(seconds * RATE_HZ)) for frame in source.poll(source.deadline_ns())]


def messages_of(pipeline: PadPipeline, frames: Iterable[Frame | WireFrame]) -> list[ContactMessage]:
    answers = (pipeline.answer(frame) for frame in frames)
    return [message_of(one) for one in answers]


def run(options: Namespace) -> None:
    rows = []
    ambients: tuple[Ambient, ...] = ("constant", "drifting")
    for effect in EFFECTS:
        if options.only and not effect.name.startswith(tuple(options.only)):
            continue
        for ambient in ambients:
            row, model = Row(effect.name, ambient, options.seed), load_contact_model(effect.config(ambient, 1))
            for seed in range(options.seed, options.seed + options.pads):
                trial(effect, ambient, seed, options.seconds, options.turn, row, model)
            print(row.line, flush=True)
            for reason, count in (*row.refused.most_common(2), *row.reasons.most_common(3)):
                print(f"    {count} × {reason}")
            rows.append(row)
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode([row.facts for row in rows])) + b"\n")
