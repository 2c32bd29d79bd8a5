"""The reports of a built pad: chips turned by hand, one imperfection or two, and one more defect."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np
from msgspec import structs

from fmfts.baseline import BaselineError
from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact import ContactModel
from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.causes import OR_DRIFTED, RIGHT_SHARE, UNCLEAR, Defect, Said, defects, frames_with
from fmfts_lab.bench.drills import RATE_HZ, Ambient
from fmfts_lab.bench.fault_kinds import SATURATED, CountFault, Counts, Fault
from fmfts_lab.bench.faults import GRACE_S, WARM_S, Healthy
from fmfts_lab.bench.silicone import EFFECTS, Effect, RealPad, RealTruth, baseline_of
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS
from fmfts_simulation.finger_shape import SHAPES
from fmfts_simulation.imperfect_chips import DISTURBED_AT_S
from fmfts_simulation.imperfections import Imperfections, PadNow
from fmfts_simulation.neighbour import seeded
from fmfts_simulation.source import Simulated

# A chip is disturbed at that moment: then the fault begins.
START_S = DISTURBED_AT_S - WARM_S
# Before the fault it is as warm as a running board, with a baseline that was recorded cold.
WARMING_K_PER_MINUTE = 600.0
# Error that no deviation covers. The others may be within the deviations of hand-placed chips: then no warning is due.
ALWAYS_SEEN = ("silent", "saturated", "stuck", "thimble", "no magnet")
BIT_ERROR_EVERY, BITS = 10, 11


def imperfections() -> list[Effect]:
    """Imperfections of `bench silicone` that a running pad can have: the baseline refuses a magnet cast askew."""
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


def _flipped(sensor: int) -> CountFault:
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
    assert isinstance(config.source, SimulatedSource)
    built, shape = Simulated(config).built, SHAPES["round"]
    pad = Imperfections(("disturbed",), shape, built, RATE_HZ, seeded(config.source, "imperfections"))
    now, nothing_t = PadNow(built, built.pad.magnet, 0.0), np.zeros((1, len(built.pad.sensors), 3))
    offset_t = pad.field(now, [], nothing_t, np.full(nothing_t.shape[:2], 2.0 * DISTURBED_AT_S))
    return int(np.argmax(np.abs(offset_t[0]).max(axis=1)))


def cause_of(effect: Effect, config: PadConfig) -> list[Defect]:
    """The reports that an imperfection allows: for most none, because they are within the deviations."""
    drifted = [Defect("offset drift", Fault("offset drift"), OR_DRIFTED)] if effect.warming_k_per_minute else []
    if "disturbed" not in effect.imperfections:
        return drifted
    sensor = disturbed_sensor(config)
    says = rf"sensor {sensor + 1} (contradicts|still contradicts|is at odds)"
    return [*drifted, Defect("disturbed chip", Fault("disturbed chip", sensor), says, UNCLEAR)]


@dataclass(slots=True)
class Judged(Said):
    """must: whether it has to be seen. wrong, wrong_degraded: answers that are more than five deviations off, after
    GRACE_S, by their health; wrong_early: before."""

    must: bool = False
    wrong: int = 0
    wrong_degraded: int = 0
    wrong_early: int = 0

    @property
    def is_right(self) -> bool:
        # A case within the deviations is correct without a warning.
        is_named = self.named >= RIGHT_SHARE * self.flagged
        return is_named and (self.flagged > 0 or not self.must) and self.wrong == 0


class ImperfectPad(Healthy):
    """A pressed pad with turned chips and imperfections. turned: after --turn, not bare and rest alone."""

    def __init__(self, effect: Effect, ambient: Ambient, seed: int, turned: bool) -> None:
        self.effect = effect
        config = _turning_once(effect.config(ambient, seed))
        before = tuple(kind for kind in effect.imperfections if kind != "disturbed")
        cold = replace(effect, imperfections=before, warming_k_per_minute=0.0).config(ambient, seed)
        baseline = baseline_of(cold, RealPad(cold), turned)
        model = model_of(ambient, effect.friction)
        super().__init__(ambient, "pressed", seed, model, config=config, baseline=baseline, start_s=START_S)

    def said(self, *case: Defect) -> Judged:
        """The reports of the pad with these defects."""
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
            is_wrong = off > WRONG_DEVIATIONS
            if number < round(GRACE_S * RATE_HZ):
                said.wrong_early += is_wrong
                continue
            said.wrong += is_wrong and message.health == "ok"
            said.wrong_degraded += is_wrong and message.health == "degraded"
            said.saw(message.health, message.reason, causes)
        return said


def _turning_once(config: PadConfig) -> PadConfig:
    """A robot that turns has the attitude of its baseline again when the pipeline starts."""
    assert isinstance(config.source, SimulatedSource)
    if not config.source.turning_deg_per_s:
        return config
    return structs.replace(config, source=structs.replace(config.source, turning_deg_per_s=360.0 / START_S))


@cache
def model_of(ambient: Ambient, friction: float) -> ContactModel:
    return load_contact_model(Effect("", friction=friction).config(ambient, 1))


@dataclass(slots=True)
class Tally:
    """A row of the table: the results of a group of cases."""

    name: str
    cases: int = 0
    right: int = 0
    frames: int = 0
    blamed: int = 0
    wrong: int = 0
    wrong_degraded: int = 0
    wrong_early: int = 0
    refused: int = 0

    def saw(self, said: Judged) -> None:
        self.cases += 1
        self.right += said.is_right
        self.frames += said.frames
        self.blamed += said.blamed_wrongly
        self.wrong += said.wrong
        self.wrong_degraded += said.wrong_degraded
        self.wrong_early += said.wrong_early

    @property
    def line(self) -> str:
        return (
            f"{self.name:54} {self.cases:3d} cases, right {self.right / max(self.cases, 1):6.1%}, a sound part blamed "
            f"in {self.blamed / max(self.frames, 1):6.2%} of {self.frames} frames; wrong: ok {self.wrong}, degraded "
            f"{self.wrong_degraded}, in the first half second {self.wrong_early}; refused {self.refused}"
        )


def possible(ambient: Ambient) -> list[Defect]:
    """A robot may turn in a field that drifts."""
    return [one for one in broken() if ambient == "constant" or one.name != "turned"]


def groups(ambient: Ambient) -> dict[str, list[tuple[Effect, list[tuple[Defect, ...]]]]]:
    """Name of a group → pads, and the defects of each."""
    sound, every = together(), imperfections()
    broken_pairs = [
        pair
        for pair in combinations(possible(ambient), 2)
        if pair[0].fault.sensor is None or pair[0].fault.sensor != pair[1].fault.sensor
    ]
    merged = [together(*pair) for pair in combinations(every, 2) if "round" in (pair[0].shape, pair[1].shape)]
    alone = [(one,) for one in possible(ambient)]
    return {
        "one imperfection": [(one, [()]) for one in every],
        "two imperfections": [(one, [()]) for one in merged],
        "one defect": [(sound, list(alone))],
        "an imperfection and a defect": [(one, list(alone)) for one in every],
        "two defects": [(sound, list(broken_pairs))],
    }


def told(
    pads: Iterable[tuple[Effect, list[tuple[Defect, ...]]]], ambient: Ambient, seed: int, turned: bool
) -> Iterator[Judged | str]:
    """The reports in each case, or the reason why the pad's baseline is refused."""
    for effect, cases in pads:
        try:
            pad = ImperfectPad(effect, ambient, seed, turned)
        except BaselineError as error:
            yield f"{effect.name}: {error}"
            continue
        for case in cases:
            yield pad.said(*case)


def run(options: Namespace) -> None:
    ambients: tuple[Ambient, ...] = options.scenes or ("constant", "drifting")
    for turned in [name == "turn" for name in options.baselines]:
        for ambient in ambients:
            for name, pads in groups(ambient).items():
                if options.only and name not in options.only:
                    continue
                tally = Tally(f"{'+ turn' if turned else 'bare + rest'}, {ambient}, {name}")
                for seed in range(options.seed, options.seed + options.pads):
                    for said in told(pads, ambient, seed, turned):
                        _count(tally, said, seed)
                print(tally.line, flush=True)


def _count(tally: Tally, said: Judged | str, seed: int) -> None:
    if isinstance(said, str):
        tally.refused += 1
        print(f"pad {seed}: {said}", flush=True)
        return
    tally.saw(said)
    if not said.is_right or said.blamed_wrongly or said.wrong_degraded or said.wrong_early:
        wrong = f"wrong: ok {said.wrong}, degraded {said.wrong_degraded}, at first {said.wrong_early}"
        print(f"pad {seed}: {'' if said.is_right else 'not right: '}{said.text}\n    {wrong}", flush=True)
