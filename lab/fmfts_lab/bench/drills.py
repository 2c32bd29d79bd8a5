"""The faults of a pad as changed counts and fields: a healthy pad with one fault at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import inf, pi, sin
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.config import PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.pad import Array, rotation_from_vector
from fmfts.pose import dipole_field
from fmfts.sensor import Frame
from fmfts.sensor.chips import DEFAULT_CHIP, TESLA_PER_GAUSS
from fmfts.simulation.finger import Finger, Touch, no_finger
from fmfts.simulation.mounted import MountedPad
from fmfts.simulation.source import TURNING_AXIS, Simulated

Ambient = Literal["constant", "drifting"]
Counts = NDArray[np.int16]
# Counts (N, 3) as the chips have them → as they arrive; called frame by frame with the counts before the fault.
CountFault = Callable[[Counts, Counts], Counts]
# Time since the fault began (s) and the pad as it was built → field (N, 3) at its sensors, in pad axes.
FieldFault = Callable[[float, MountedPad, Touch], Array]

RATE_HZ = 220
FRAME_NS = round(1e9 / RATE_HZ)
TURNING_DEG_PER_S = 60.0  # the robot's turn, if the scene's field drifts
LAST_COUNT, SATURATED = DEFAULT_CHIP.largest_count, DEFAULT_CHIP.saturated_count
AS_DRAWN = ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0)
MAGNETIC_CONSTANT = 4e-7 * pi
AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Fault:
    """kind: its name in the table. sensor: the one that the daemon must name, None if the field itself is foreign.

    counts, field: its effect. valid: whether the sensor still answers. swapped: two sensors whose wires are exchanged.
    """

    kind: str
    sensor: int | None = None
    counts: CountFault | None = None
    field: FieldFault | None = None
    valid: bool = True
    swapped: tuple[int, int] | None = None


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
            self._foreign(float(moment) - self._begin_s, self._built, self.finger(float(moment)))[sensor]
            if self._begin_s <= moment < self._end_s
            else np.zeros(3)
            for sensor, moment in enumerate(sampled_s)
        ]
        return own + self._built.sensed(np.array(foreign))


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


def sensor_faults(sensors: Sequence[int], axes: Sequence[int]) -> list[Fault]:
    """All kinds of sensor fault, for each of these sensors and axes."""
    faults = [Fault("invalid", sensor, valid=False) for sensor in sensors]
    for sensor in sensors:
        for axis in axes:
            at = (sensor, axis)
            faults += [
                Fault("saturated", sensor, _set(at, lambda now, before: SATURATED)),
                Fault("stuck", sensor, _set(at, lambda now, before: before)),
                *(
                    Fault(f"offset {offset_mg} mG", sensor, _set(at, _added(offset_mg * 1e-3)))
                    for offset_mg in (30, 100)
                ),
                *(Fault(f"gain {percent} %", sensor, _set(at, _scaled(1.0 + percent / 100))) for percent in (2, 5)),
            ]
    return faults


def _set(at: tuple[int, int], change: Callable[[int, int], float]) -> CountFault:
    def apply(now: Counts, before: Counts) -> Counts:
        counts = now.copy()
        if now[at] != SATURATED:
            changed = round(change(int(now[at]), int(before[at])))
            counts[at] = changed if abs(changed) <= LAST_COUNT else SATURATED
        return counts

    return apply


def _added(gauss: float, gain_code: int = 3) -> Callable[[int, int], float]:
    counts = gauss * DEFAULT_CHIP.counts_per_gauss[gain_code][0]  # all axes alike
    return lambda now, before: now + counts


def _scaled(factor: float) -> Callable[[int, int], float]:
    return lambda now, before: now * factor


def field_faults() -> list[Fault]:
    """The faults of the surroundings, not of a sensor."""
    faults = [
        Fault(f"neighbour {distance_mm} mm, {how}", field=_neighbour(distance_mm * 1e-3, how == "moving"))
        for distance_mm in (30, 45, 60, 80, 100)
        for how in ("fixed", "moving")
    ]
    faults.append(Fault("steel approaching", field=_steel))
    faults += [Fault(f"field step {step_mg} mG", field=_step(step_mg * 1e-3)) for step_mg in (10, 30, 100)]
    faults += [Fault(f"turning {deg_per_s} deg/s", field=_turning(deg_per_s)) for deg_per_s in (2, 5, 20)]
    faults += [
        Fault(f"wires {one + 1} and {other + 1} swapped", swapped=(one, other))
        for one, other in combinations(range(4), 2)
    ]
    faults.append(Fault("magnet lost, returned", field=_weaker(1.0, until_s=0.6)))
    faults.append(Fault("demagnetised to half", field=_weaker(0.5)))
    return faults


def _neighbour(distance_m: float, moving: bool) -> FieldFault:
    """An equal magnet beside this one; moving: a finger of its own presses and tilts it twice a second."""

    def field(time_s: float, built: MountedPad, touch: Touch) -> Array:
        down = (1.0 - np.cos(4 * pi * time_s)) / 2.0 if moving else 0.0
        place = built.pad.rest_position_m + np.array([distance_m, 0.0, -1e-3 * down])
        axis = np.array([np.sin(0.2 * down), 0.0, np.cos(0.2 * down)])
        return dipole_field(built.pad.sensors.position_m, place, axis, built.pad.magnet.strength_t_m3)

    return field


def _steel(time_s: float, built: MountedPad, touch: Touch) -> Array:
    """A steel ball of 10 mm that comes from 80 to 30 mm in a second. Its moment is 3V/µ0 times the field at its place.

    J. D. Jackson, Classical Electrodynamics, 5.11: a sphere of µ ≫ 1 in a uniform field.
    """
    place = np.array([80e-3 - 50e-3 * min(time_s, 1.0), 0.0, 10e-3])
    (position,), (axis,) = built.pose(np.array([touch.x_m]), np.array([touch.y_m]), np.array([touch.force_n]))
    magnet = dipole_field(place[None], position, axis, built.pad.magnet.strength_t_m3)[0]
    inducing = magnet + built.ambient_t
    # dipole_field's strength is µ0·m/4π; a sphere's is R³·B.
    strength = 5e-3**3 * float(np.linalg.norm(inducing))
    return dipole_field(built.pad.sensors.position_m, place, inducing / np.linalg.norm(inducing), strength)


def _step(gauss: float) -> FieldFault:
    direction = np.array([0.6, -0.64, 0.48]) * gauss * TESLA_PER_GAUSS
    return lambda time_s, built, touch: np.tile(direction, (len(built.pad.sensors), 1))


def _turning(deg_per_s: float) -> FieldFault:
    """The robot begins to turn in the Earth's field, which a constant scene excludes."""

    def field(time_s: float, built: MountedPad, touch: Touch) -> Array:
        turn = rotation_from_vector(TURNING_AXIS * np.deg2rad(deg_per_s) * time_s)
        return np.tile(turn @ built.ambient_t - built.ambient_t, (len(built.pad.sensors), 1))

    return field


def _weaker(share: float, until_s: float = np.inf) -> FieldFault:
    """The magnet loses `share` of its moment, and has it again after `until_s`."""

    def field(time_s: float, built: MountedPad, touch: Touch) -> Array:
        count = len(built.pad.sensors)
        if time_s > until_s:
            return np.zeros((count, 3))
        return -share * built.magnet_field(*(np.full(count, value) for value in touch))

    return field
