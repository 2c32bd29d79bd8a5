"""A field that alternates, from mains or a motor, before or after the baseline: is it found, named, and counted?"""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from fmfts.baseline import BaselineError
from fmfts.baseline.request import DURATION_S, BaselineRequest
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array, Pad
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose import dipole_field
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor.frame import WireFrame
from fmfts_lab.bench.as_built import RELEASE_S
from fmfts_lab.bench.built_world import Presses
from fmfts_lab.bench.drills import Ambient, pad_config
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS, Truth
from fmfts_simulation.finger import no_finger

When = Literal["before", "after"]
WHENS: tuple[When, ...] = ("before", "after")
AMPLITUDES_UT = (0.2, 0.5, 1.0, 2.0, 5.0)
MAINS_HZ, RATES_HZ = (50.0, 60.0), (75, 110, 160, 220)
BEGIN_S = 1.0  # after the baseline: when the touch begins
MOTOR_HZ, MOTOR_M, MOTOR_A_M2 = 30.0, 0.05, 0.01
# Times (…) in s and the pad → field (…, N, 3) in T, along the pad's axes.
Alternating = Callable[[Array, Pad], Array]


def mains(hz: float, amplitude_t: float, random: np.random.Generator) -> Alternating:
    """The field of a distant cable: everywhere alike, along any direction, often along the pad's normal."""
    direction = np.array([0.0, 0.0, 1.0]) if random.random() < 0.3 else random.standard_normal(3)
    field_t, phase = amplitude_t * direction / np.linalg.norm(direction), random.uniform(0.0, 2.0 * np.pi)
    return lambda time_s, pad: field_t * np.cos(2.0 * np.pi * hz * time_s + phase)[..., None]


def motor(time_s: Array, pad: Pad) -> Array:
    """A small magnet that spins beside the pad, about its normal."""
    place_m, angle = pad.rest_position_m + np.array([MOTOR_M, 0.0, 0.0]), 2.0 * np.pi * MOTOR_HZ * time_s
    along = [dipole_field(pad.sensors.position_m, place_m, axis, 1e-7 * MOTOR_A_M2) for axis in np.eye(3)[:2]]
    field_t: Array = along[0] * np.cos(angle)[..., None] + along[1] * np.sin(angle)[..., None]
    return field_t


class Alternated(ManyFrames):
    """A simulated pad in a field that alternates from `begin_s` on."""

    field: Alternating | None = None
    begin_s = -np.inf

    def recorded(self, seconds: float) -> list[WireFrame]:
        """The next frames, from time zero of a new recording."""
        self._sequence = 0
        self._delivered[:] = np.iinfo(np.int64).min
        return [frame for batch in self.batches(round(seconds * self._rate_hz)) for frame in batch]

    def _fields(self, sampled_s: Array) -> Array:
        return super()._fields(sampled_s) if self.mounted else self._built.sensed(self._ambients(sampled_s))

    def _ambients(self, sampled_s: Array) -> Array:
        own = super()._ambients(sampled_s)
        if self.field is None:
            return own
        alternating = self.field(sampled_s, self._built.pad)
        return own + np.where((sampled_s >= self.begin_s)[..., None], alternating, 0.0)


@dataclass(slots=True)
class Row:
    """The results of one row, over all pads, rates and frequencies. wrong, false_contacts: one number for each pad."""

    runs: int = 0
    refused: int = 0
    named: int = 0
    frames: int = 0
    worst: float = 0.0
    rest_frames: int = 0
    wrongs: list[int] = field(default_factory=list)
    falses: list[int] = field(default_factory=list)
    health: Counter[str] = field(default_factory=Counter)
    deviations_n: list[float] = field(default_factory=list)

    def begin_pad(self) -> None:
        self.wrongs.append(0)
        self.falses.append(0)

    @property
    def wrong(self) -> int:
        return sum(self.wrongs)

    @property
    def false_contacts(self) -> int:
        return sum(self.falses)

    @property
    def line(self) -> str:
        published = sum(self.health[name] for name in PUBLISHED) / max(self.frames, 1)
        deviation_n = f"{np.median(self.deviations_n):.2f}" if self.deviations_n else "-"
        return (
            f"published {published:7.2%}, wrong {_of_pads(self.wrongs)} of {self.frames}, worst {self.worst:4.1f} sd, "
            f"false contacts {_of_pads(self.falses)} of {self.rest_frames}, named in {self.named:2d} of {self.runs}, "
            f"refused {self.refused}, force ± {deviation_n} N"
        )

    def saw(self, frames: list[WireFrame], pipeline: PadPipeline, truth: Truth, finger: Presses) -> None:
        messages = [message_of(pipeline.answer(frame)) for frame in frames]
        deviations = truth.all_deviations(messages)
        self.runs += 1
        self.frames += len(messages)
        self.wrongs[-1] += int((deviations > WRONG_DEVIATIONS).sum())
        self.worst = max(self.worst, float(deviations.max()))
        self.health.update(message.health for message in messages)
        self.named += any("alternates at" in message.reason for message in messages)
        for message in messages:
            time_s = message.t_sample_ns * 1e-9
            if finger(time_s).force_n == finger(time_s - RELEASE_S).force_n == 0.0:
                self.rest_frames += 1
                self.falses[-1] += message.contact is True
            elif message.contact and message.force_sd_n is not None:
                self.deviations_n.append(message.force_sd_n)


def _of_pads(counts: list[int]) -> str:
    return "+".join(map(str, counts))


def trial(config: PadConfig, model: ContactModel, field: Alternating, when: When, seconds: float, row: Row) -> None:
    rate_hz, source = config.source.rate_hz, Alternated(config)
    turning, source.turning_rad_per_s, source.finger = source.turning_rad_per_s, 0.0, no_finger
    source.field = field if when == "before" else None
    tracking = tracking_model_for(config.scene, config.magnet).tracking
    pipeline, baseline = PadPipeline(config.pad(), model, "bench", float(rate_hz), tracking), None
    try:
        for bare in (True, False):
            source.mounted = not bare
            request = BaselineRequest(config.pad(), config.tolerance.si(), bare=bare, replaced=False)
            baseline, _ = request.make(source.recorded(DURATION_S), baseline)
    except BaselineError:
        row.refused += 1
        return
    assert baseline is not None
    pipeline.use(baseline)
    finger = Presses(np.random.default_rng(rate_hz))
    source.turning_rad_per_s, source.field, source.finger = turning, field, finger
    source.begin_s = BEGIN_S if when == "after" else -np.inf
    row.saw(source.recorded(seconds), pipeline, Truth(source.built, finger), finger)


def at_rate(ambient: Ambient, seed: int, rate_hz: int) -> PadConfig:
    config = pad_config(ambient, seed)
    return msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, rate_hz=rate_hz))


def row_of(ambient: Ambient, when: When, amplitude_t: float | None, seeds: Sequence[int], seconds: float) -> Row:
    """All frequencies, rates and pads of one cell of the table. amplitude_t: None is the motor."""
    row = Row()
    for seed in seeds:
        model = load_contact_model(pad_config(ambient, seed))
        random = np.random.default_rng([seed, round((amplitude_t or 0.0) * 1e9)])
        row.begin_pad()
        for rate_hz in RATES_HZ:
            fields = [motor] if amplitude_t is None else [mains(hz, amplitude_t, random) for hz in MAINS_HZ]
            for each in fields:
                trial(at_rate(ambient, seed, rate_hz), model, each, when, seconds, row)
    return row


def run(options: Namespace) -> None:
    seeds = range(options.seed, options.seed + options.pads)
    for ambient in options.scenes:
        for when in WHENS:
            for amplitude_ut in (*options.amplitudes_ut, None):
                amplitude_t = None if amplitude_ut is None else amplitude_ut * 1e-6
                row = row_of(ambient, when, amplitude_t, seeds, options.seconds)
                name = "motor " if amplitude_ut is None else f"{amplitude_ut:3.1f} µT"
                print(f"{ambient:8} {when:6} {name}  {row.line}", flush=True)
