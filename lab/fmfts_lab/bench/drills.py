"""A healthy pad with one fault at a time (fault_kinds.py): its frames, as changed counts and fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, pi, sin
from typing import Literal

import numpy as np

from fmfts.config import PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.pad import Array
from fmfts.sensor import Frame
from fmfts_lab.bench.fault_kinds import Fault, FieldFault, PadThen
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Finger, Touch, columns, no_finger
from fmfts_simulation.source import Simulated

Ambient = Literal["constant", "drifting"]

RATE_HZ = 220
FRAME_NS = round(1e9 / RATE_HZ)
TURNING_DEG_PER_S = 60.0  # the robot's turn, if the scene's field drifts
AS_DRAWN = ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0)


def pad_config(ambient: Ambient, seed: int) -> PadConfig:
    """A pad whose gains are good to ±0.5 % after a self-test, its chips as drawn: `bench as-built` turns them."""
    turning = TURNING_DEG_PER_S if ambient == "drifting" else 0.0
    return PadConfig(
        name="drill",
        source=SimulatedSource(seed=seed, finger="none", turning_deg_per_s=turning),
        tolerance=AS_DRAWN,
        scene=SceneConfig(ambient=ambient),
    )


def live_finger(time_s: float) -> Touch:
    """1 N beside the centre, as unsteady as a hand, so that a sensor with constant readings can be noticed."""
    rise = min(max((time_s - 0.1) / 0.3, 0.0), 1.0)
    force = 0.5 * (1.0 - np.cos(pi * rise)) * (1.0 + 0.2 * sin(2 * pi * 0.9 * (time_s - 0.4)))
    return Touch(2e-3, -1.5e-3, float(force))


FINGERS: dict[str, Finger] = {"rest": no_finger, "pressed": live_finger}


class DrillSource(Simulated):
    """A simulated pad with a foreign field from `begin_s` on. Its first frame is that at `start_s` of its clock."""

    def __init__(
        self,
        config: PadConfig,
        field: FieldFault | None = None,
        begin_s: float = 0.0,
        end_s: float = inf,
        start_s: float = 0.0,
    ) -> None:
        super().__init__(config)
        self._start_ns, self._sequence = 0, round(start_s * RATE_HZ)
        self._foreign = field
        self._begin_s, self._end_s = begin_s, end_s

    def _field(self, sampled_s: Array, warming_k: float) -> Array:
        own = super()._field(sampled_s, warming_k)
        if self._foreign is None or sampled_s.max() < self._begin_s:
            return own
        foreign = [
            self._foreign(moment - self._begin_s, self._then(moment))[sensor]
            if self._begin_s <= moment < self._end_s
            else np.zeros(3)
            for sensor, moment in enumerate(sampled_s.tolist())
        ]
        return own + self._built.sensed(np.array(foreign))

    def _then(self, moment_s: float) -> PadThen:
        return PadThen(self._built, self.finger(moment_s), lambda places_m: self._field_of_magnets(places_m, moment_s))

    def _field_of_magnets(self, places_m: Array, moment_s: float) -> Array:
        """The field (M, K, 3) of each magnet at places (K, 3)."""
        position_m, axis = self._built.pose(*columns([self.finger(moment_s)]))
        return cylinder_field(places_m, position_m, axis, self._built.pad.magnet)[None]


def record(source: Simulated, finger: Finger, seconds: float) -> list[Frame]:
    source.finger, first = finger, round(source.time_s * RATE_HZ)
    return [frame for step in range(round(seconds * RATE_HZ)) for frame in source.poll((first + step) * FRAME_NS)]


def spoiled(frames: Sequence[Frame], fault: Fault, begin: int, end: int) -> list[Frame]:
    """The same frames with a sensor's fault in those from `begin` to `end`."""
    if fault.swapped is not None:
        return [_exchanged(frame, fault.swapped) if begin <= i < end else frame for i, frame in enumerate(frames)]
    if fault.sensor is None:
        return list(frames)
    before, result = frames[begin - 1].counts, []
    for number, frame in enumerate(frames):
        if begin <= number < end:
            counts = frame.counts if fault.counts is None else fault.counts(frame.counts, before)
            valid = frame.valid.copy()
            valid[fault.sensor] &= fault.valid
            frame = replace(frame, counts=counts, valid=valid)
        result.append(frame)
    return result


def _exchanged(frame: Frame, sensors: tuple[int, int]) -> Frame:
    order = list(range(len(frame.counts)))
    one, other = sensors
    order[one], order[other] = other, one
    return replace(
        frame,
        counts=frame.counts[order],
        age_us=frame.age_us[order],
        fresh=frame.fresh[order],
        valid=frame.valid[order],
    )
