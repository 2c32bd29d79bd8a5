"""Detects that an ambient field moves although the scene calls it constant: a turning robot is no broken sensor."""

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
from fmfts.pose.track import Track

log = logging.getLogger(__name__)

# While frames are not ok, one in EVERY is solved again, and LOOKS of them decide: 0.4 s at 220 Hz.
EVERY, LOOKS = 8, 12
# The share of frames that misfit by chance although a moved ambient field explains them.
MISFIT = 1e-4
# The offset of a faulty sensor stays constant. A field that moves by more than both limits (5 mG) shows a moving robot.
MOVED_DEVIATIONS, MOVED_T = 6.0, 5e-7
# A turning pad passes through the orientation of its baseline: only after a second of ok frames does it count as ok.
WELL_FRAMES = 220


@dataclass(slots=True)
class AmbientMotionMemory:
    """lowest_t, highest_t (3,): range of the ambient field in the frames that it explained. explained: whether it
    explained each of the last LOOKS frames. moved_t: how far the field was found to move, 0 if it was not."""

    lowest_t: Array
    highest_t: Array
    explained: list[bool] = field(default_factory=list)
    moved_t: float = 0.0
    frames_seen: int = 0
    well_frames: int = 0
    logged: bool = False


class AmbientMotionDetector:
    """Judges the frames of one pad whose model holds the ambient field fixed."""

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
        """Whether the ambient field was found to move; frames are then `disturbed`."""
        return self.memory.moved_t > 0.0

    @property
    def frames_before_look(self) -> int:
        """So many frames that are not ok may pass unseen."""
        return EVERY - 1 - self.memory.frames_seen % EVERY

    def passed(self, frames: int, were_ok: bool) -> None:
        """Note that the fast path judged so many frames: all ok, or all without a sensor, which tell nothing."""
        self.memory.frames_seen += frames
        if not were_ok:
            self.memory.well_frames = 0
            return
        self.memory.well_frames += frames
        if self.memory.well_frames >= WELL_FRAMES:
            self._forget()

    def judge(self, track: Track, field_t: Array, deviation_t: Array) -> Track:
        """Returns `track`, or `disturbed` while the field moves. field_t, deviation_t (N, 3): as for the tracker."""
        self.memory.frames_seen += 1
        if track.stronger:  # an ambient field as large would explain steel on a finger, too
            self._forget()
        elif track.health == "ok":
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
