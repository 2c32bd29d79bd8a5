"""The reports of a running pad about each defect, alone and in pairs: is the cause named, and is a healthy part
blamed?
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from fmfts.pipeline.configured import load_contact_model
from fmfts.sensor import Frame
from fmfts_lab.bench.drills import RATE_HZ, Ambient, pad_config, record, spoiled
from fmfts_lab.bench.fault_kinds import Fault, FieldFault, PadThen, field_faults, sensor_faults, weaker
from fmfts_lab.bench.faults import FAULT_S, GRACE_S, WARM_S, Healthy
from fmfts_simulation.finger_shape import thimble_field
from fmfts_simulation.imperfections import TOP_M

RIGHT_SHARE = 0.9
# A sentence that blames one sensor, and the parts of one that blames one of several: "sensor 1 or 2".
BLAMED = re.compile(r"sensors? (\d)(?: (?:or|and) (\d))*", re.IGNORECASE)
# Two equally likely causes, both reported.
OR_FOREIGN = "or a weak foreign field is near"
OR_DRIFTED = "or offsets of chips drifted"
# Not counted as blame: a saturated axis is read from its counts. A strong field saturates healthy sensors, too.
SEEN_SATURATED = re.compile(r"sensor \d is saturated")


@dataclass(frozen=True, slots=True)
class Defect:
    """What is wrong with a running pad. says: what its messages' reason must contain. sensor: from 0, if one is wrong.

    alike: another cause with the same effect in a field that drifts; then either may be said.
    """

    name: str
    fault: Fault
    says: str
    alike: str = ""

    @property
    def sensors(self) -> set[int]:
        return set() if self.fault.sensor is None else {self.fault.sensor + 1}


def _thimble(time_s: float, then: PadThen) -> np.ndarray:
    """Steel on the finger that presses."""
    press = (np.array([one]) for one in then.touch[:3])
    position_m, axis = then.built.pose(*press)
    return np.asarray(thimble_field(then.places_m, position_m, axis, TOP_M, then.built.pad.magnet))


FOREIGN = r"steel|magnet|foreign"
UNCLEAR = (
    rf"is a little off(, {OR_FOREIGN})?: it is not clear|may be at fault|two sensors are wrong|another sensor is wrong"
)


def defects(sensor: int = 1, other: int = 2) -> list[Defect]:
    """Sensor faults on two sensors (from 0), and disturbances of the field."""
    one = {fault.kind: fault for fault in sensor_faults((sensor,), (0,))}
    two = {fault.kind: fault for fault in sensor_faults((other,), (2,))}
    fields = {fault.kind: fault for fault in field_faults()}
    first, second = f"sensor {sensor + 1}", f"sensor {other + 1}"
    return [
        Defect("silent", one["invalid"], rf"{first} .*(silent|new sample|answer|missing)"),
        Defect("saturated", one["saturated"], rf"{first} is saturated on x"),
        Defect("stuck", two["stuck"], rf"{second} .*(stuck|same|repeat)"),
        Defect("offset", two["offset 100 mG"], rf"{second} (contradicts|still contradicts|is at odds)", UNCLEAR),
        Defect("gain", one["gain 5 %"], rf"{first} (contradicts|still contradicts|is at odds)", UNCLEAR),
        Defect("neighbour", fields["neighbour 30 mm, moving"], FOREIGN),
        Defect("turned", fields["turning 20 deg/s"], r"ambient field moves|turned robot|robot has turned"),
        Defect("thimble", Fault("thimble", field=_thimble), FOREIGN),
        Defect("no magnet", Fault("no magnet", field=weaker(1.0)), r"is the pad mounted|magnet whole"),
    ]


@dataclass(slots=True)
class Said:
    """The reports about one case from GRACE_S after its beginning: reasons, with the number of frames."""

    case: tuple[str, ...]
    ambient: str
    reasons: Counter[str] = field(default_factory=Counter)
    frames: int = 0
    ok: int = 0
    named: int = 0
    blamed_wrongly: int = 0

    def saw(self, health: str, reason: str, case: Sequence[Defect]) -> None:
        self.frames += 1
        if health == "ok":
            self.ok += 1
            return
        self.reasons[re.sub(r"\d+", "#", reason) if "χ²" in reason or "%" in reason else reason] += 1
        self.named += any(re.search(one.says, reason) or (one.alike and re.search(one.alike, reason)) for one in case)
        broken = set().union(*(one.sensors for one in case))
        inferred = SEEN_SATURATED.sub("", reason)
        sensors = [{int(number) for number in re.findall(r"\d", found.group())} for found in BLAMED.finditer(inferred)]
        # It is no wrong blame if one of them is correct.
        either = (OR_FOREIGN in reason and any(one.fault.field is not None for one in case)) or (
            OR_DRIFTED in reason and any(one.says == OR_DRIFTED for one in case)
        )
        self.blamed_wrongly += not either and any(not named & broken for named in sensors)

    @property
    def flagged(self) -> int:
        return self.frames - self.ok

    @property
    def is_right(self) -> bool:
        """Named in nine of ten frames that are not ok. An undetected case does not count as right."""
        return self.flagged > 0 and self.named >= RIGHT_SHARE * self.flagged

    @property
    def text(self) -> str:
        named, blamed = self.named / max(self.flagged, 1), self.blamed_wrongly / self.frames
        reasons = "".join(f"\n    {times} × {reason}" for reason, times in self.reasons.most_common(3))
        return (
            f"{self.ambient:8} {' + '.join(self.case):24} ok {self.ok / self.frames:4.0%} named {named:4.0%} "
            f"wrongly blamed {blamed:4.0%}{reasons}"
        )


def frames_with(healthy: Healthy, case: Sequence[Defect]) -> list[Frame]:
    fields = [one.fault.field for one in case if one.fault.field is not None]
    frames = healthy.frames
    if fields:
        frames = record(healthy.source(_together(fields)), healthy.finger, WARM_S + FAULT_S)
    for one in case:
        frames = spoiled(frames, one.fault, healthy.begin, healthy.end)
    return frames


def _together(fields: Sequence[FieldFault]) -> FieldFault:
    def field(time_s: float, then: PadThen) -> np.ndarray:
        return np.asarray(sum(one(time_s, then) for one in fields))

    return field


def said_of(healthy: Healthy, case: Sequence[Defect]) -> Said:
    said, pipeline = Said(tuple(one.name for one in case), healthy.ambient), healthy.pipeline()
    for number, frame in enumerate(frames_with(healthy, case)[: healthy.end]):
        if number >= healthy.begin:
            message = pipeline.process(frame)
            if number >= healthy.begin + round(GRACE_S * RATE_HZ):
                said.saw(message.health, message.reason, case)
    return said


def cases(count: int, ambient: Ambient) -> list[tuple[Defect, ...]]:
    """Each `count` defects that a pad can have together: one for each sensor. A robot may turn in a drifting field."""

    def distinct(case: Sequence[Defect]) -> bool:
        sensors = [one.fault.sensor for one in case if one.fault.sensor is not None]
        return len(set(sensors)) == len(sensors)

    possible = [one for one in defects() if ambient == "constant" or one.name != "turned"]
    return [case for case in combinations(possible, count) if distinct(case)]


def run(options: Namespace) -> None:
    ambients: tuple[Ambient, ...] = ("constant", "drifting")
    everything: list[Said] = []
    for ambient in options.scenes or ambients:
        model = load_contact_model(pad_config(ambient, options.seed))
        healthy = Healthy(ambient, "pressed", options.seed, model)
        for count in options.together:
            for case in cases(count, ambient):
                said = said_of(healthy, case)
                everything.append(said)
                if options.verbose or not said.is_right or said.blamed_wrongly:
                    print(said.text, flush=True)
    right, blamed = np.mean([one.is_right for one in everything]), sum(one.blamed_wrongly for one in everything)
    print(
        f"{len(everything)} cases: right {right:.1%}, frames that blame a sound part "
        f"{blamed / sum(one.frames for one in everything):.2%}"
    )
