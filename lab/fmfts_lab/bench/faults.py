"""How the daemon's pipeline reports broken sensors and foreign fields, and how often it is wrong."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import msgspec

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts.sensor import Frame
from fmfts_lab.bench.drills import FINGERS, RATE_HZ, Ambient, DrillSource, pad_config, record, spoiled
from fmfts_lab.bench.fault_kinds import Fault, FieldFault, field_faults, sensor_faults
from fmfts_lab.bench.tapped import Well, tapped, without_baseline
from fmfts_lab.bench.truth import WRONG_DEVIATIONS, Truth
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger

# AFTER_S: mean residuals forget a fault in half a second; a moved field is reported for a second more.
WARM_S, FAULT_S, AFTER_S = 0.7, 1.2, 2.0
GRACE_S = 0.5
AMBIENTS: tuple[Ambient, ...] = ("constant", "drifting")


@dataclass(slots=True)
class Outcome:
    """The results for one kind of fault in one situation, over all sensors and axes. Times in ms, shares 0 to 1."""

    kind: str
    ambient: str
    touch: str
    drills: int = 0
    frames: int = 0
    detected_ms: list[float] = field(default_factory=list)
    named: int = 0
    alarmed: int = 0
    wrong_early: int = 0
    wrong_late: int = 0
    worst: float = 0.0
    back_ms: list[float] = field(default_factory=list)
    health: Counter[str] = field(default_factory=Counter)

    @property
    def line(self) -> str:
        seen = f"{len(self.detected_ms):3d}/{self.drills:<3d}"
        named = f"{100 * self.named / self.alarmed:5.0f}" if self.alarmed else "    -"
        shares = " ".join(f"{100 * self.health[name] / self.frames:5.0f}" for name in HEALTHS)
        wrong = f"{self.wrong_early:6d} {self.wrong_late:6d} {self.worst:7.1f}"
        return (
            f"{self.kind:24} {self.ambient:8} {self.touch:7} {seen} {_spread(self.detected_ms)} {named} {wrong}"
            f"  {shares}  {len(self.back_ms):3d}/{self.drills:<3d} {_spread(self.back_ms)}"
        )


HEALTHS = ("ok", "degraded", "disturbed", "lost")
HEADER = (
    "                                          seen     detected ms named  wrong frames  worst   "
    "% of frames in the fault\n"
    "fault                    scene    pad     drills     p50    max     %  <.5 s  after     sd     "
    "ok  degr  dist  lost   ok again, ms p50 max"
)


def _spread(times: Sequence[float]) -> str:
    """Median and largest."""
    return f"{sorted(times)[len(times) // 2]:5.0f} {max(times):6.0f}" if times else "    -      -"


class Healthy:
    """A healthy mounted pad, with a pipeline that has tracked it up to the beginning of the fault."""

    def __init__(
        self,
        ambient: Ambient,
        touch: str,
        seed: int,
        model: ContactModel,
        *,
        config: PadConfig | None = None,
        baseline: Baseline | None = None,
        start_s: float = 0.0,
    ) -> None:
        """config: for a pad other than `pad_config`. baseline: None records it. start_s: the first frame's time."""
        self.ambient, self.touch = ambient, touch
        self.config = config or pad_config(ambient, seed)
        self._start_s = start_s
        self.finger: Finger = lambda time_s: FINGERS[touch](time_s - start_s)
        self.model = model
        before = without_baseline(self.config, model)
        before.use(baseline or simulated_baseline(self.config))
        source = self.source()
        self.truth = Truth(source.built, self.finger)
        self.frames = record(source, self.finger, WARM_S + FAULT_S + AFTER_S)
        self.begin = round(WARM_S * RATE_HZ)
        self.end = round((WARM_S + FAULT_S) * RATE_HZ)
        for frame in self.frames[: self.begin]:
            before.process(frame)
        self._baseline, self._mounting, self._memory = before.baseline, before.mounting, snapshot(before)

    def source(self, field: FieldFault | None = None) -> DrillSource:
        """The pad with a foreign field while the fault lasts."""
        begin_s = self._start_s + WARM_S
        return DrillSource(self.config, field, begin_s, begin_s + FAULT_S, self._start_s)

    def pipeline(self) -> PadPipeline:
        """A copy of the pipeline, in its state when the fault begins."""
        pipeline = without_baseline(self.config, self.model)
        assert self._baseline is not None
        pipeline.use(self._baseline, self._mounting)
        restore(pipeline, self._memory)
        return pipeline

    def frames_with(self, fault: Fault) -> list[Frame]:
        if fault.field is None:
            return spoiled(self.frames, fault, self.begin, self.end)
        return record(self.source(fault.field), self.finger, WARM_S + FAULT_S + AFTER_S)

    def drill(self, fault: Fault, outcome: Outcome) -> None:
        frames, pipeline = self.frames_with(fault), self.pipeline()
        detected = False
        outcome.drills += 1
        for number in range(self.begin, self.end):
            message = pipeline.process(frames[number])
            since_s = (number - self.begin) / RATE_HZ
            outcome.frames += 1
            outcome.health[message.health] += 1
            off = self.truth.deviations(message)
            outcome.worst = max(outcome.worst, off)
            outcome.wrong_early += off > WRONG_DEVIATIONS and since_s <= GRACE_S
            outcome.wrong_late += off > WRONG_DEVIATIONS and since_s > GRACE_S
            if message.health != "ok":
                outcome.alarmed += 1
                outcome.named += named_right(message, fault)
                if not detected:
                    outcome.detected_ms.append(since_s * 1e3)
                detected = True
        for later, frame in enumerate(frames[self.end :]):
            if pipeline.process(frame).health == "ok":
                outcome.back_ms.append(later / RATE_HZ * 1e3)
                break


def named_right(message: ContactMessage, fault: Fault) -> bool:
    if fault.sensor is None:
        return message.health in ("disturbed", "lost")
    return message.health == "degraded" and message.reason.startswith(f"sensor {fault.sensor + 1} ")


def drilled(
    faults: Sequence[Fault],
    seeds: Iterable[int],
    ambients: Sequence[Ambient] = AMBIENTS,
    touches: Sequence[str] = tuple(FINGERS),
) -> list[Outcome]:
    """Every fault in every situation."""
    outcomes: dict[tuple[str, str, str], Outcome] = {}
    for seed in seeds if faults else ():
        model = load_contact_model(pad_config("constant", seed))
        for ambient in ambients:
            for touch in touches:
                healthy = Healthy(ambient, touch, seed, model)
                for fault in faults:
                    key = (fault.kind, ambient, touch)
                    outcome = outcomes.setdefault(key, Outcome(*key))
                    healthy.drill(fault, outcome)
    return list(outcomes.values())


def run(options: Namespace) -> None:
    """Print the table; with `options.out`, the same facts as JSON."""
    quick = options.quick
    faults = sensor_faults((0,), (0, 2)) if quick else sensor_faults(range(4), range(3))
    foreign = field_faults()
    faults, foreign = _only(options.only, faults), _only(options.only, foreign)
    drilled_pads = range(options.seed, options.seed + (1 if quick else options.drilled))
    outcomes = drilled(faults, drilled_pads, options.scenes)
    outcomes += drilled(foreign, drilled_pads, options.scenes, ("pressed",) if quick else tuple(FINGERS))
    print(HEADER)
    for outcome in sorted(outcomes, key=lambda one: (one.ambient, one.touch)):
        print(outcome.line)
    seeds, seconds = (range(1, 2), 5.0) if quick else (range(1, 1 + options.pads), options.seconds)
    wells = [tapped(ambient, seeds, seconds) for ambient in options.scenes if seconds > 0.0]
    for well in wells:
        print(well.line, flush=True)
    if options.out is not None:
        options.out.write_bytes(as_json(outcomes, wells))


def _only(kinds: Sequence[str], faults: list[Fault]) -> list[Fault]:
    """The faults whose kind begins with one of `kinds`; all of them if `kinds` is empty."""
    return [fault for fault in faults if fault.kind.startswith(tuple(kinds or ("",)))]


def as_json(outcomes: list[Outcome], wells: list[Well]) -> bytes:
    """The data of the printed lines; an infinite number of deviations becomes null."""
    return msgspec.json.format(msgspec.json.encode({"faults": outcomes, "healthy": wells}), indent=1) + b"\n"
