"""Faults, steel, turning and warm-up on a pad with four magnets: is the result right or flagged? For `several
--drills`.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

from fmfts.bus.messages import ContactMessage
from fmfts.pipeline.configured import Pipeline, contact_model_of, pipeline_of
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts_lab.bench.causes import BLAMED
from fmfts_lab.bench.fault_kinds import Fault
from fmfts_lab.bench.faults import named_right
from fmfts_lab.bench.several_faults import FINGERS, RATE_HZ, Drill, drill_config, drills, frames_of
from fmfts_lab.bench.truth import WRONG_DEVIATIONS
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Touch

STANDING = Drill("")
HEAD = (
    "| drill | fingers | seen | after, ms: half, all | named | sound sensor blamed | ok | fingers not told | wrong, ok "
    "| wrong, degraded | false fingers | worst, deviations | ok again, ms: half, all |\n" + "| --- " * 13 + "|"
)


@dataclass(slots=True)
class Counted:
    """Drills of one kind. frames: while the fault lasts. judged: these frames, and those afterwards. wrong: judged
    frames that are published as good and off by more than five deviations. false: more fingers than there are. flagged:
    not ok while something is broken. named, blamed: flagged frames that name the defect, and that name a healthy
    sensor.
    """

    drills: int = 0
    frames: int = 0
    good: int = 0
    silent: int = 0
    judged: int = 0
    wrong: int = 0
    wrong_degraded: int = 0
    false: int = 0
    worst: float = 0.0
    flagged: int = 0
    named: int = 0
    blamed: int = 0
    seen_ms: list[float] = field(default_factory=list)
    back_ms: list[float] = field(default_factory=list)

    def drill(self, drill: Drill, fingers: str, seed: int) -> None:
        """Take one pad through it."""
        pipeline, frames = _pipeline(seed), frames_of(drill, fingers, seed)
        self.drills += 1
        seen = back = False
        for number, frame in enumerate(frames):
            message = pipeline.process(frame)
            if number < drill.begin:
                continue
            self._judge(message, [finger(message.t_sample_ns * 1e-9) for finger in FINGERS[fingers]])
            if number < drill.end:
                self._count(message, drill.fault)
                if message.health != "ok" and not seen:
                    seen = True
                    self.seen_ms.append((number - drill.begin) / RATE_HZ * 1e3)
            elif message.health == "ok" and not back:
                back = True
                self.back_ms.append((number - drill.end) / RATE_HZ * 1e3)

    def _count(self, message: ContactMessage, fault: Fault | None) -> None:
        self.frames += 1
        self.good += message.health == "ok"
        self.silent += not isinstance(message.contacts, list)
        if message.health != "ok" and fault is not None:
            self.flagged += 1
            self.named += named_right(message, fault)
            broken = {number + 1 for number in fault.swapped or (() if fault.sensor is None else (fault.sensor,))}
            said = [set(map(int, re.findall(r"\d", one.group()))) for one in BLAMED.finditer(message.reason)]
            self.blamed += any(not sensors & broken for sensors in said)

    def _judge(self, message: ContactMessage, truth: list[Touch]) -> None:
        self.judged += 1
        if not isinstance(message.contacts, list):
            return
        touching = [touch for touch in truth if touch.force_n > 0.0]
        self.false += len(message.contacts) > len(touching)
        off_by = _deviations(message, touching)
        if message.health == "ok":
            self.worst = max(self.worst, off_by)
            self.wrong += off_by > WRONG_DEVIATIONS
        else:
            self.wrong_degraded += off_by > WRONG_DEVIATIONS

    def row(self, kind: str, fingers: str) -> str:
        seen = f"{len(self.seen_ms)} of {self.drills} | {_spread(self.seen_ms)}"
        named, blamed = (f"{one / self.flagged:.0%}" if self.flagged else "–" for one in (self.named, self.blamed))
        good, silent = self.good / self.frames, self.silent / self.frames
        return (
            f"| {kind} | {fingers} | {seen} | {named} | {blamed} | {good:.1%} | {silent:.1%} | {self.wrong} of "
            f"{self.judged:,} | {self.wrong_degraded} | {self.false} | {self.worst:.1f} | {_spread(self.back_ms)} |"
        )


def _spread(times: Sequence[float]) -> str:
    return f"{sorted(times)[len(times) // 2]:.0f}, {max(times):.0f}" if times else "–"


def run(options: Namespace) -> None:
    print(HEAD)
    rows: dict[str, list[Drill]] = {}
    for drill in drills():
        rows.setdefault(drill.kind, []).append(drill)
    for kind, members in rows.items():
        if options.only and not kind.startswith(tuple(options.only)):
            continue
        for fingers in FINGERS:
            counted = Counted()
            for drill in members:
                for seed in range(options.seed, options.seed + options.pads):
                    counted.drill(drill, fingers, seed)
            print(counted.row(kind, fingers), flush=True)


def _pipeline(seed: int) -> Pipeline:
    """The pipeline of one pad before its first frame."""
    pipeline, memory = _made(seed)
    restore(pipeline, memory)
    return pipeline


@cache
def _made(seed: int) -> tuple[Pipeline, bytes]:
    config = drill_config(STANDING, seed)
    pipeline = pipeline_of(config, contact_model_of(config), "drill")
    pipeline.use(simulated_baseline(config))  # before it warms
    return pipeline, snapshot(pipeline)


def _deviations(message: ContactMessage, truth: list[Touch]) -> float:
    """The errors of published results in their own deviations: of the resultant's force, and of each finger if their
    number is right.
    """
    if message.force_n is None or message.force_sd_n is None:
        return 0.0
    worst = abs(message.force_n - sum(touch.force_n for touch in truth)) / message.force_sd_n
    contacts = message.contacts if isinstance(message.contacts, list) else []
    if len(contacts) != len(truth):
        return worst
    for told, true in zip(sorted(contacts, key=lambda one: one.x_m), sorted(truth), strict=True):
        each = (
            (told.x_m - true.x_m) / told.x_sd_m,
            (told.y_m - true.y_m) / told.y_sd_m,
            (told.force_n - true.force_n) / told.force_sd_n,
        )
        worst = max(worst, *map(abs, each))
    return worst
