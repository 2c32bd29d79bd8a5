"""Silicone that is squeezed for long: is it taken for touched while it recovers, and a hold for another force?"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.config import SiliconeConfig
from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.drills import Ambient
from fmfts_lab.bench.silicone import Effect, RealPad, baseline_of, frames_of, messages_of
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import PUBLISHED
from fmfts_simulation.finger import Finger, Touch

BEGIN_S, RAMP_S = 1.0, 0.2
HOLD_S = 60.0


@dataclass(frozen=True, slots=True)
class Squeeze:
    """A finger: `force_n` at one place for `seconds`, after BEGIN_S without a touch."""

    touch: Touch
    seconds: float

    def __call__(self, time_s: float) -> Touch:
        share = min(max(min(time_s - BEGIN_S, self.end_s - time_s) / RAMP_S, 0.0), 1.0)
        return self.touch._replace(force_n=share * self.touch.force_n) if share else Touch(0.0, 0.0, 0.0)

    @property
    def end_s(self) -> float:
        return BEGIN_S + self.seconds


def squeezed(
    finger: Finger,
    seconds: float,
    ambient: Ambient,
    seed: int,
    creep_times: float = 1.0,
    turn: bool = True,
    counted: bool = True,
) -> list[ContactMessage]:
    """The messages of a pad that creeps, pressed by this finger. creep_times: as much creep as is configured.

    counted: False takes the silicone for a spring in the configuration.
    """
    config = Effect("silicone", ("silicone",)).config(ambient, seed)
    if not counted:
        config = msgspec.structs.replace(config, silicone=SiliconeConfig(0.0, 0.0))
    pipeline = without_baseline(config, load_contact_model(config))
    pipeline.use(baseline_of(config, RealPad(config), turn))
    source = RealPad(config)
    source.finger = finger
    source.creep_times(creep_times)
    return messages_of(pipeline, frames_of(source, config, seconds))


def longest_contact_s(messages: Sequence[ContactMessage], after_s: float) -> float:
    """The longest time that a contact was reported after the finger had gone."""
    longest_s, since_s = 0.0, None
    for message in messages:
        now_s = message.t_sample_ns * 1e-9
        if now_s < after_s:
            continue
        since_s = (now_s if since_s is None else since_s) if message.contact else None
        longest_s = max(longest_s, 0.0 if since_s is None else now_s - since_s)
    return longest_s


def force_deviations(messages: Sequence[ContactMessage], force_n: float, first_s: float, last_s: float) -> np.ndarray:
    """(K,) errors of the force between two times, in its deviations."""
    held = [one for one in messages if first_s < one.t_sample_ns * 1e-9 < last_s and one.health in PUBLISHED]
    return np.array([(one.force_n - force_n) / one.force_sd_n for one in held if one.force_n and one.force_sd_n])


def run(options: Namespace) -> None:
    ambients: tuple[Ambient, ...] = ("constant", "drifting")
    for creep in options.creep:
        for ambient in ambients:
            for seed in range(options.seed, options.seed + options.pads):
                hard = Squeeze(Touch(2e-3, -1.5e-3, 4.0), options.seconds)
                messages = squeezed(hard, hard.end_s + 20.0, ambient, seed, creep)
                longest_s = longest_contact_s(messages, hard.end_s)
                after = [one for one in messages if one.t_sample_ns * 1e-9 > hard.end_s + 1.0]
                residual_n = max((one.force_n or 0.0) for one in after)
                print(
                    f"creep × {creep:g} {ambient:8} pad {seed}: 4 N for {options.seconds:g} s, then a contact for "
                    f"{longest_s:.2f} s, force without contact up to {residual_n * 1e3:.0f} mN, "
                    f"ok {np.mean([one.health == 'ok' for one in messages]):.2%}",
                    flush=True,
                )
                for force_n in (0.4, 1.0, 1.8):
                    soft = Squeeze(Touch(-3e-3, 2e-3, force_n), HOLD_S)
                    messages = squeezed(soft, soft.end_s + 5.0, ambient, seed, creep)
                    errors = np.abs(force_deviations(messages, force_n, BEGIN_S + RAMP_S, soft.end_s - RAMP_S))
                    print(
                        f"    {force_n:g} N for {HOLD_S:g} s: within one deviation {np.mean(errors < 1.0):.1%}, two "
                        f"{np.mean(errors < 2.0):.1%}, worst {errors.max():.1f}; then a contact for "
                        f"{longest_contact_s(messages, soft.end_s):.2f} s",
                        flush=True,
                    )
