"""From steps of MuJoCo to the frames of all pads in a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from fmfts.config import PadConfig
from fmfts.pad import Array, rotation_from_vector
from fmfts.sensor.frame import Frame
from fmfts_simulation.silicone import Silicone

from fmfts_mujoco.as_built import Structures
from fmfts_mujoco.boards import SILICONE, Boards, Faults, built_of
from fmfts_mujoco.history import History
from fmfts_mujoco.loads import Reader, Step, responses
from fmfts_mujoco.places import Places
from fmfts_mujoco.stacked import Stacked
from fmfts_mujoco.surroundings import Surroundings

READ_EVERY_S = 0.004  # a chip measures every 4.5 ms, and silicone gives way slowly
AROUND_EVERY_S = 0.02  # at 300 °/s a hand turns by 6° meanwhile: the nonlinear part is less than half the noise


class Scene:
    """The pads of one model. Times are seconds since `start`."""

    def __init__(self, model: mujoco.MjModel, pads: Sequence[PadConfig], *, as_built: bool = False) -> None:
        """as_built: pads differ from their drawing as their tolerances say, each `start` by other silicone and fingers.
        ModelError where the model lacks a pad, or a pad cannot be simulated here."""
        self.pads = list(pads)
        self._as_built = as_built
        self._model = model
        places = Places.of(model, pads)
        self.stacked = Stacked([built_of(pad, as_built=as_built) for pad in pads])
        self.boards = Boards(pads, self.stacked)
        self._reader = Reader(model, places)
        self._surroundings = Surroundings(model, places, self.stacked)
        self._has_silicone = SILICONE in pads[0].source.imperfections  # type: ignore[union-attr]
        self.start(np.random.default_rng(0))

    def start(self, random: np.random.Generator) -> None:
        """Switch all boards on; nothing pressed any pad yet."""
        pads, sensors = self.stacked.pads, self.stacked.sensors
        if self._as_built:
            self.stacked.structures = Structures.drawn(self.pads, random)
        self.boards.start(random)
        self._silicone = Silicone(pads) if self._has_silicone else None
        self._steps: list[Step] = []
        self._moved, self._around = History(pads, 5), History(pads, sensors, 3)
        self._around_s = self._read_s = -np.inf
        self._since_s, self._last_s = None, 0.0

    @property
    def faults(self) -> dict[str, Faults]:
        """The faults by pad; they may be changed at any time."""
        return dict(zip((pad.name for pad in self.pads), self.boards.faults, strict=True))

    def record(self, data: mujoco.MjData) -> float:
        """Look at the step that MuJoCo took last. Returns the time of its beginning.

        Where MuJoCo's time leaps back, as after a reset, the pads' time goes on.
        """
        time_s = data.time - self._model.opt.timestep
        if self._since_s is None:
            self._since_s = time_s
        elif time_s - self._since_s <= self._last_s:
            self._since_s = time_s - self._last_s - self._model.opt.timestep
        self._last_s = time_s - self._since_s
        if self._last_s >= self._read_s + READ_EVERY_S - 1e-6:
            self._read_s = self._last_s
            self._steps.append(self._reader.read(data, self._last_s))
        return self._last_s

    def frames(self) -> list[list[Frame]]:
        """The frames of each pad that were completed since the last call."""
        if not self._steps:
            return [[] for _ in self.pads]
        steps, self._steps = self._steps, []
        time_s = np.array([step.time_s for step in steps])
        response = responses(steps, self.stacked)
        if self._silicone is not None:
            times_s = np.broadcast_to(time_s[:, None], response.shape[:2])
            response = self._silicone.moved(times_s, response)
        self._moved.add(time_s, response)
        self._look_around(steps, response)
        frames = self.boards.frames(steps[-1].time_s, self._moved, self._around)
        for history in (self._moved, self._around):
            history.forget(self.boards.oldest_s)
        return frames

    def unloaded(self, data: mujoco.MjData, seconds: float, *, bare: bool, turned: bool = False) -> list[list[Frame]]:
        """Frames of all pads while nothing presses any, and the robot stands still as it is. bare: each of them as if
        it was off its sensors, but its neighbours were not. turned: somebody turns the robot once about each axis."""
        step = self._reader.read(data, 0.0)
        pads = self.stacked.pads
        moved, around = History(pads, 5), History(pads, self.stacked.sensors, 3)
        still = np.zeros((1, pads, 5))
        moved.add(np.zeros(1), still)
        time_s = np.arange(0.0, seconds, AROUND_EVERY_S) if turned else np.zeros(1)
        fields_t = [self._surroundings.field(_turned(step, each / seconds), still[0]) for each in time_s]
        around.add(time_s, np.array(fields_t))
        self.boards.start(np.random.default_rng(bare))
        return self.boards.frames(seconds, moved, around, bare=bare)

    def _look_around(self, steps: list[Step], response: Array) -> None:
        """Looks around in some of these steps, and in the last one."""
        seen = []
        for number, step in enumerate(steps):
            if number == len(steps) - 1 or step.time_s - self._around_s >= AROUND_EVERY_S:
                seen.append(number)
                self._around_s = step.time_s
        field_t = [self._surroundings.field(steps[number], response[number]) for number in seen]
        self._around.add(np.array([steps[number].time_s for number in seen]), np.array(field_t))


def _turned(step: Step, share: float) -> Step:
    """One step of a robot that turns once about x, then y, then z; share: of the whole turn, 0 to 1."""
    turn = np.eye(3)
    for axis, vector in enumerate(np.eye(3)):
        turn = turn @ rotation_from_vector(vector * 2.0 * np.pi * np.clip(3.0 * share - axis, 0.0, 1.0))
    return replace(step, origin_m=step.origin_m @ turn.T, turn=turn @ step.turn)
