"""One lift: the gripper closes, lifts an object a little, looks for the least force, lifts on, holds and may move.

MuJoCo judges: how hard the fingers press, whether the object is still there, and how far it slid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np
from fmfts.baseline import Baseline
from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts_client import Contact
from numpy.typing import NDArray

from fmfts_mujoco.in_process import Pads
from fmfts_mujoco.objects import Object, filled
from fmfts_mujoco.over_bus import Robot

PERIOD_S = 0.01
LOAD_M_PER_S, AIR_M = 0.02, 0.015  # this slowly, and this high, before the search for the least force
LIFT_M_PER_S, LIFT_M_PER_S2, HIGH_M = 0.1, 0.5, 0.08
SETTLE_S, LONGEST_S, FILLS_S, HOLD_S, PATIENCE_S = 0.4, 4.0, 3.0, 2.0, 15.0
LARGEST_WAY_M = 0.045
IN_AIR_M, PEAK_S = 5e-3, 0.25


class Controller(Protocol):
    """`clients/python/examples/grip.py`, or a rival."""

    found: bool

    def step(self, pads: list[Contact | None], loosen: bool, period_s: float) -> Any: ...


@dataclass
class Lift:
    """MuJoCo's values every PERIOD_S: phase, force of a finger, least force, height of object and of fingers."""

    thing: Object
    phase: list[str] = field(default_factory=list)
    force_n: list[float] = field(default_factory=list)
    least_n: list[float] = field(default_factory=list)
    object_m: list[float] = field(default_factory=list)
    fingers_m: list[float] = field(default_factory=list)
    told_slips: int = 0

    def during(self, *phases: str) -> NDArray[np.bool_]:
        return np.isin(self.phase, phases)

    @property
    def lifted(self) -> bool:
        """The object once reached the height of the lift."""
        return bool(np.max(self.object_m) - self.object_m[0] > 0.5 * HIGH_M)

    @property
    def held(self) -> bool:
        """It is still between the fingers at the end, when the arm is up."""
        below_m = np.array(self.fingers_m) - np.array(self.object_m)
        return self.phase[-1] == "end" and bool(below_m[-1] - below_m[0] < 0.5 * HIGH_M)

    @property
    def dropped(self) -> bool:
        """It was in the air, and no longer is. An arm that waits too long with the object in the air drops nothing."""
        above_m = np.array(self.object_m) - self.object_m[0]
        return not self.held and bool(above_m.max() > IN_AIR_M > above_m[-1])

    def shares(self, *phases: str) -> Array:
        """Force over least force, which counts the largest acceleration of the last and the next PEAK_S."""
        there = self.during(*phases)
        around = round(PEAK_S / PERIOD_S)
        padded = np.pad(self.least_n, around, mode="edge")
        peak_n = np.lib.stride_tricks.sliding_window_view(padded, 2 * around + 1).max(axis=1)
        return np.array(self.force_n)[there] / peak_n[there]

    def slid_m(self, *phases: str) -> float:
        """How far the object slid down the fingers."""
        there = self.during(*phases)
        way_m = (np.array(self.fingers_m) - np.array(self.object_m))[there]
        return float(np.ptp(way_m)) if there.any() else 0.0


def pads_here(
    configs: list[PadConfig], recorded: Mapping[str, Baseline], seed: int, *, as_built: bool
) -> Callable[[mujoco.MjModel, mujoco.MjData], Pads]:
    """In this process, and as fast as it can."""

    def made(model: mujoco.MjModel, data: mujoco.MjData) -> Pads:
        pads = Pads(model, data, configs, recorded, as_built=as_built)
        pads.reset(seed)
        return pads

    return made


class Lifting:
    """A gripper around one object, with its pads."""

    def __init__(
        self,
        thing: Object,
        pads: Callable[[mujoco.MjModel, mujoco.MjData], Pads | Robot],
        motion_m: Array | None = None,
    ) -> None:
        """pads: makes those of a model that stands like this. motion_m: how far the arm moves up at last, by period."""
        self.thing, self.model = thing, thing.model()
        self._motion_m = np.empty(0) if motion_m is None else motion_m
        for most_m in (self.model.jnt_range[self.model.joint("lift").id], self.model.actuator("lift").ctrlrange):
            most_m[1] += self._motion_m.max(initial=0.0)
        self.data = mujoco.MjData(self.model)
        self.pads = pads(self.model, self.data)
        self.lift = Lift(thing)
        self._newest: dict[str, Contact] = {}
        self._substeps = round(PERIOD_S / self.model.opt.timestep)
        self._body, self._carriage = (self.model.body(name).id for name in ("object", "carriage"))
        self._way_m = self._up_m = self._up_m_per_s = self._speed_m_per_s = 0.0
        self._phase, self._since_s, self._mass_kg = "close", 0.0, thing.mass_kg

    def run(self, controller: Controller, usable: Any) -> Lift:
        """usable: of the controller's program: may it act on a contact of this age?"""
        target = self.data.ctrl.copy()
        for _ in range(round(PATIENCE_S / PERIOD_S) + len(self._motion_m)):
            before = self.data.ctrl.copy()
            for substep in range(self._substeps):  # a motor's force does not jump
                self.data.ctrl[:] = before + (target - before) * (substep + 1) / self._substeps
                mujoco.mj_step(self.model, self.data)
                self.pads.step(self.data)
            command = controller.step(self._contacts(usable), self._phase == "air", PERIOD_S)
            self._way_m = min(max(self._way_m + command.close_m_per_s * PERIOD_S, 0.0), LARGEST_WAY_M)
            self._next(command.may_lift, controller.found)
            target = np.array([self._way_m, self._way_m, self._up_m])
            self._note()
            if self._phase == "end":
                break
        return self.lift

    def _contacts(self, usable: Any) -> list[Contact | None]:
        for name, told in self.pads.contacts().items():
            if len(told):
                self._newest[name] = told[-1]
        newest = [self._newest.get(name) for name in ("left_pad", "right_pad")]
        now_ns = self.pads.now_ns
        return [
            each if each is not None and usable(each, (now_ns - each.t_sample_ns) * 1e-9) else None for each in newest
        ]

    def _next(self, may_lift: bool, found: bool) -> None:
        """The arm."""
        self._since_s += PERIOD_S
        before = self._phase
        if self._phase == "close" and may_lift:
            self._phase = "load"
        elif self._phase == "load":
            self._up_m += LOAD_M_PER_S * PERIOD_S * may_lift
            self._phase = "air" if self._up_m >= AIR_M else "load"
        elif self._phase == "air":
            known = found and may_lift and self._since_s > SETTLE_S
            self._phase = "lift" if known or self._since_s > LONGEST_S else "air"
        elif self._phase == "lift":
            left_m = HIGH_M - self._up_m
            self._up_m_per_s = min(
                self._up_m_per_s + LIFT_M_PER_S2 * PERIOD_S,
                LIFT_M_PER_S,
                np.sqrt(2.0 * LIFT_M_PER_S2 * max(left_m, 0.0)),
            )
            self._up_m += self._up_m_per_s * PERIOD_S
            self._phase = "hold" if left_m < 1e-4 else "lift"
        elif self._phase == "hold":
            fills = self.thing.full > 1.0 and self._since_s < FILLS_S
            if fills:
                mass_kg = self.thing.mass_kg * (1.0 + (self.thing.full - 1.0) * self._since_s / FILLS_S)
                filled(self.model, self._body, mass_kg / self._mass_kg)
                self._mass_kg = mass_kg
            self._phase = "move" if self._since_s > HOLD_S + FILLS_S * (self.thing.full > 1.0) else "hold"
        if self._phase == "move":
            number = round(self._since_s / PERIOD_S) if before == "move" else 0
            if number < len(self._motion_m):
                self._up_m = HIGH_M + float(self._motion_m[number])
            else:
                self._phase = "end"
        if self._phase != before:
            self._since_s = 0.0

    def _note(self) -> None:
        lift, data = self.lift, self.data
        lift.phase.append(self._phase)
        lift.force_n.append(float(data.sensordata.mean()))
        speed_m_per_s = float(data.joint("lift").qvel[0])
        acceleration_m_per_s2 = (speed_m_per_s - self._speed_m_per_s) / PERIOD_S
        self._speed_m_per_s = speed_m_per_s
        lift.least_n.append(self.thing.least_n(self._mass_kg, acceleration_m_per_s2))
        lift.object_m.append(float(data.xpos[self._body, 2]))
        lift.fingers_m.append(float(data.xpos[self._carriage, 2]))
