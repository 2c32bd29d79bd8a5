"""What a running pad as built says: chips turned by hand, one imperfection or two, and what may break besides."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np
from msgspec import structs

from fmfts.baseline import Baseline
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pipeline.configured import load_contact_model
from fmfts.simulation.imperfect_chips import DISTURBED_AT_S, ImperfectChips
from fmfts.simulation.neighbour import seeded
from fmfts_lab.bench.causes import FOREIGN, UNCLEAR, Defect, Said, defects, frames_with
from fmfts_lab.bench.drills import RATE_HZ, SATURATED, Ambient, Counts, Fault
from fmfts_lab.bench.faults import GRACE_S, WARM_S, Healthy
from fmfts_lab.bench.silicone import EFFECTS, Effect, RealPad, RealTruth, baseline_of
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS

# A chip is disturbed at that moment: then the fault begins.
START_S = DISTURBED_AT_S - WARM_S
# As warm as a board becomes before it, its baseline recorded cold.
WARMING_K_PER_MINUTE = 600.0
# What no deviation takes. The other defects may be within those of chips that a hand placed; then nothing is to be said.
ALWAYS_SEEN = ("silent", "saturated", "stuck", "thimble", "no magnet")
BIT_ERROR_EVERY, BITS = 10, 11


def imperfections() -> list[Effect]:
    """Those of `bench silicone` that a running pad has: a magnet cast askew is refused by its baseline."""
    warm = {"offset drift, 15 K": WARMING_K_PER_MINUTE}
    unlike = ("none", "casting, unnamed", "bit errors", "thimble")
    return [
        replace(one, warming_k_per_minute=warm.get(one.name, 0.0)) for one in EFFECTS if not one.name.startswith(unlike)
    ]


def together(*effects: Effect) -> Effect:
    """One pad with all of them."""
    return Effect(
        " + ".join(one.name for one in effects),
        tuple(kind for one in effects for kind in one.imperfections),
        next((one.shape for one in effects if one.shape != "round"), "round"),
        max((one.warming_k_per_minute for one in effects), default=0.0),
        any(one.cast_is_named for one in effects),
        max((one.friction for one in effects), default=0.0),
    )


def broken(sensor: int = 1) -> list[Defect]:
    """The defects of `bench causes`, and a bus that flips a bit of one sensor's reading now and then."""
    bits = Fault("bit errors", sensor, _flipped(sensor))
    return [*defects(sensor), Defect("bit errors", bits, defects(sensor)[4].says, UNCLEAR)]


def _flipped(sensor: int) -> object:
    def apply(now: Counts, before: Counts) -> Counts:
        # The counts' own noise chooses frame, axis and bit: the same frames give the same errors.
        chance = int(np.abs(now.astype(np.int64)).sum())
        counts, axis = now.copy(), chance % 3
        if chance // 3 % BIT_ERROR_EVERY == 0 and counts[sensor, axis] != SATURATED:
            counts[sensor, axis] ^= np.int16(1 << chance // 30 % BITS)
        return counts

    return apply


def disturbed_sensor(config: PadConfig) -> int:
    """The sensor (from 0) whose offset a strong field changes on this pad."""
    chips = ImperfectChips(("disturbed",), 4, config.pad().chip, RATE_HZ, seeded(config.source, "imperfections"))
    offset_t = chips.reported(np.full((1, 4), 2 * DISTURBED_AT_S), np.zeros((1, 4, 3)), 0.0)[0]
    return int(np.argmax(np.abs(offset_t).max(axis=1)))


def cause_of(effect: Effect, config: PadConfig) -> list[Defect]:
    """What may be said of an imperfection. Of most nothing: they are within the deviations."""
    if "disturbed" not in effect.imperfections:
        return []
    sensor = disturbed_sensor(config)
    says = rf"sensor {sensor + 1} (contradicts|still contradicts|is at odds)"
    return [Defect("disturbed chip", Fault("disturbed chip", sensor), says, UNCLEAR)]


@dataclass(slots=True)
class Judged(Said):
    """must: whether it has to be seen. wrong: answers that are ok or degraded and more than five deviations off, after
    GRACE_S; wrong_early: before."""

    must: bool = False
    wrong: int = 0
    wrong_early: int = 0
    worst: float = 0.0

    @property
    def is_right(self) -> bool:
        is_named = self.named >= 0.9 * self.flagged
        return is_named and (self.flagged > 0 or not self.must) and self.wrong == 0


class ImperfectPad(Healthy):
    """A pressed pad with turned chips and imperfections. turned: after --turn, not bare and rest alone."""

    def __init__(self, effect: Effect, ambient: Ambient, seed: int, turned: bool) -> None:
        self.effect = effect
        config = _turning_once(effect.config(ambient, seed))
        before = tuple(kind for kind in effect.imperfections if kind != "disturbed")
        cold = replace(effect, imperfections=before, warming_k_per_minute=0.0).config(ambient, seed)
        baseline = baseline_of(cold, RealPad(cold), turned)
        super().__init__(
            ambient, "pressed", seed, model_of(ambient, effect.friction), config=config, baseline=baseline, start_s=START_S
        )

    def said(self, *case: Defect) -> Judged:
        """What is said where these defects befall it."""
        causes = [*cause_of(self.effect, self.config), *case]
        names = (*([self.effect.name] if self.effect.name else ["turned chips"]), *(one.name for one in case))
        said = Judged(names, self.ambient, must=any(one.name in ALWAYS_SEEN for one in case))
        pipeline, truth = self.pipeline(), RealTruth(self.source(), self.config, self.finger)
        frames = frames_with(self, case)
        for frame in frames[: self.begin]:
            time_s = frame.host_time_ns * 1e-9
            truth.poses([time_s], [self.finger(time_s)])  # silicone remembers
        for number, frame in enumerate(frames[self.begin : self.end]):
            message = pipeline.process(frame)
            off = truth.deviations(message) if message.health in PUBLISHED else 0.0
            said.worst = max(said.worst, off)
            if number < round(GRACE_S * RATE_HZ):
                said.wrong_early += off > WRONG_DEVIATIONS
                continue
            said.wrong += off > WRONG_DEVIATIONS
            said.saw(message.health, message.reason, causes)
        return said


def _turning_once(config: PadConfig) -> PadConfig:
    """A robot that turns has the attitude of its baseline again when the pipeline starts."""
    assert isinstance(config.source, SimulatedSource)
    if not config.source.turning_deg_per_s:
        return config
    return structs.replace(config, source=structs.replace(config.source, turning_deg_per_s=360.0 / START_S))


@cache
def model_of(ambient: Ambient, friction: float):
    return load_contact_model(Effect("", friction=friction).config(ambient, 1))
