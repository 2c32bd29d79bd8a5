"""Whether an ambient field that a scene calls constant is: a robot that turns must not be taken for a broken sensor."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length
from fmfts.common.chi2 import quantile
from fmfts.pad import Array, Pad
from fmfts.pose.problem import Status
from fmfts.pose.solver import FREE_FIELD, solve
from fmfts.pose.state import AMBIENT, State
from fmfts.pose.tracker import Track

log = logging.getLogger(__name__)

# While frames are not well, one in so many is looked at: 0.4 s at 220 Hz tell.
EVERY, LOOKS = 8, 12
# Of the frames that a moving field explains, so many misfit by chance.
MISFIT = 1e-4
# A sensor's offset stays; a field that moves by more than this many deviations, and this far (5 mG), is the robot's.
MOVED_DEVIATIONS, MOVED_T = 6.0, 5e-7
# A pad that turns passes through the orientation of its baseline: it is well again when it has been so for a second.
WELL_FRAMES = 220


@dataclass(slots=True)
class AmbientMotionMemory:
    """lowest_t, highest_t (3,): of the ambient field over the last LOOKS looks, of which `explained` says whether a
    changed ambient field explained them. moved_t: by how much it was found to move, 0 while it was not."""

    lowest_t: Array
    highest_t: Array
    explained: list[bool] = field(default_factory=list)
    moved_t: float = 0.0
    frames_seen: int = 0
    well_frames: int = 0
    logged: bool = False


class AmbientMotionDetector:
    """Of one pad whose model holds the ambient field fixed."""

    def __init__(self, pad: Pad, rest: State) -> None:
        self._pad = pad
        self._rest = rest
        self.memory = AmbientMotionMemory(np.full(3, np.inf), np.full(3, -np.inf))

    def _forget(self) -> None:
        memory = self.memory
        memory.explained, memory.moved_t = [], 0.0
        memory.lowest_t, memory.highest_t = np.full(3, np.inf), np.full(3, -np.inf)

    @property
    def is_moving(self) -> bool:
        """Whether the field was found to be no constant one, and a frame's verdict does not stand."""
        return self.memory.moved_t > 0.0

    def passed(self, frames: int) -> None:
        """So many frames were well, and judged by the compiled path."""
        self.memory.frames_seen += frames
        self.memory.well_frames += frames
        if self.memory.well_frames >= WELL_FRAMES:
            self._forget()

    def judge(self, track: Track, field_t: Array, deviation_t: Array) -> Track:
        """The frame's track, or what it says of the field; field_t, deviation_t (N, 3): what the tracker was given."""
        self.memory.frames_seen += 1
        if track.health == "ok":
            self.memory.well_frames += 1
            if self.memory.well_frames >= WELL_FRAMES:
                self._forget()
        else:
            self.memory.well_frames = 0
            if self.memory.frames_seen % EVERY == 0:
                self._look(field_t, deviation_t)
        if not self.is_moving:
            return track
        used: NDArray[np.bool_] = np.isfinite(field_t)
        return Track(None, used, "disturbed", self._reason())

    def _reason(self) -> str:
        return (
            f'the ambient field moves, by {self.memory.moved_t * 1e7:.0f} mG, and scene.ambient = "constant" says that '
            'it does not: where the pad turns, or a magnet moves far off, set ambient = "drifting" in [pad.scene]'
        )

    def _look(self, field_t: Array, deviation_t: Array) -> None:
        if not np.isfinite(field_t).all():
            return
        estimate = solve(field_t, self._pad, self._rest, deviation_t=deviation_t, free=FREE_FIELD)
        fits = estimate.status is Status.CONVERGED and estimate.chi2 < quantile(MISFIT, estimate.degrees_of_freedom)
        memory = self.memory
        memory.explained = [*memory.explained, fits][-LOOKS:]
        if not fits:
            return
        ambient = estimate.state.ambient_t
        memory.lowest_t, memory.highest_t = np.minimum(memory.lowest_t, ambient), np.maximum(memory.highest_t, ambient)
        moved = length(memory.highest_t - memory.lowest_t)
        deviation = float(np.sqrt(np.trace(estimate.covariance[AMBIENT, AMBIENT])))
        if sum(memory.explained) >= LOOKS - 1 and moved > max(MOVED_T, MOVED_DEVIATIONS * deviation):
            memory.moved_t = max(memory.moved_t, moved)
            if not memory.logged:
                memory.logged = True
                log.warning("pad '%s': %s", self._pad.name, self._reason())
