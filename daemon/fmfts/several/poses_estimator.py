"""One pad with several magnets and no table of presses: field → poses of all magnets, and whether the pad is touched.

Place and force of a finger need a table (estimator.py). The field alone determines the magnets' poses, if the sensors
give enough values (free_poses.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError
from fmfts.contact.touch import TouchDetector
from fmfts.pose import Aligned
from fmfts.pose.magnets import CHANGE
from fmfts.pose.neighbour import NeighbourEstimate
from fmfts.pose.observable import FEWEST_SPARE, taken_values
from fmfts.pose.state import Neighbour
from fmfts.several import reasons, searches
from fmfts.several.arrays import doubles
from fmfts.several.count import Search
from fmfts.several.field_model import FieldModel
from fmfts.several.free_poses import FreePoses, free_poses, is_explained
from fmfts.several.measured import Measured
from fmfts.several.odd_pose_sensor import Values, odd_pose_sensor
from fmfts.several.odd_sensor import note_agreement
from fmfts.several.reading import PosesMemory, PosesReading
from fmfts.several.recovery import Recovery
from fmfts.several.sighted import sighted
from fmfts.several.since_rest import CONSTANT, SinceRest, Warmth, begun
from fmfts.several.trust import trusted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class PosesEstimator:
    """Field → poses of a pad that has a baseline. Parameters as of FingersEstimator."""

    def __init__(self, model: FieldModel, rate_hz: float, repeats_allowed: Array, warmth: Warmth = CONSTANT) -> None:
        pad, mounting = model.pad, model.mounting
        self.pad, self.mounting, self.scene, self._model = pad, mounting, model.scene, model
        self.repeats_allowed = repeats_allowed
        self._since_rest = SinceRest(pad, mounting, repeats_allowed, warmth)
        self._touch = TouchDetector(rate_hz, magnets=len(pad.magnets))
        self._fewest = taken_values(len(pad.magnets)) + FEWEST_SPARE
        self._rest_c = warmth.rest_c
        self.start_anew()

    def start_anew(self) -> None:
        """Forget all frames."""
        now_t, change = np.zeros(self.mounting.gain.size), np.zeros(CHANGE * len(self.pad.magnets))
        self.recall(PosesMemory(Recovery(now_t), last_c=self._rest_c, change=change, now_t=now_t))

    def recall(self, memory: PosesMemory) -> None:
        """Go on from the memory of another estimator of the same pad, baseline and scene."""
        self.memory, self._touch.memory = memory, memory.touch

    def forget_touch(self) -> None:
        self._touch.forget()

    def sighted(self, reading: PosesReading) -> tuple[tuple[Neighbour, ...], Array] | None:
        """The magnets in the last frame, and the covariance (6M, 6M) of a step from there; None if it does not tell."""
        if reading.poses is None:
            return None
        return sighted(self.mounting, reading.poses, self._since_rest.moment, self.scene.moment)

    def read(
        self,
        aligned: Aligned,
        temperature_c: float | None,
        missing: Mapping[int, str],
        neighbours: Sequence[NeighbourEstimate] = (),
        may_search: bool = True,
    ) -> PosesReading:
        """Judge one aligned frame; parameters as of FingersEstimator.read."""
        memory = self.memory
        elapsed_s = begun(aligned, memory, self._touch.longest_gap_s, self._touch.forget)
        memory.recovery.pass_time(elapsed_s, pressed=memory.touch.touched)
        self._since_rest.begin(temperature_c, memory, elapsed_s)
        # Of frames that nothing explains, `now_t` is older, and what decays must not begin at it again.
        now_t = doubles(np.minimum(memory.now_t, memory.recovery.recent_t))
        measured, jumped = self._since_rest.measured(aligned, neighbours, memory, now_t)
        there = measured.used.reshape(-1, 3)
        used = there.copy()
        if memory.left_out >= 0:
            used[memory.left_out] = False
            if np.count_nonzero(used) < self._fewest <= np.count_nonzero(there):
                memory.left_out, used = -1, there.copy()  # it is needed now, and may have recovered
        if np.count_nonzero(used) < self._fewest:
            self._touch.unseen()
            return PosesReading("lost", reasons.too_few_for_poses(missing, used, self._fewest), used)
        try:
            reading = self._judged(measured, used, there, missing, may_search)
        except SingularError:
            self._touch.unseen()
            return PosesReading("lost", reasons.POSES_UNDETERMINED, used)
        return trusted(reading, memory, jumped)

    def _judged(
        self, measured: Measured, used: Mask, there: Mask, missing: Mapping[int, str], may_search: bool
    ) -> PosesReading:
        memory, around_t = self.memory, self._since_rest.around_t
        poses = self._solved(measured, used)
        search: Search = "none"
        explained, odd = is_explained(poses, used), None
        if not explained and searches.is_searched(memory.unexplained):
            search = "made" if may_search else "due"
        if search == "made":
            with_all = poses if memory.left_out < 0 else self._solved(measured, there)
            number = searches.number_of(memory.unexplained)
            values = Values(measured, there, around_t)
            odd = odd_pose_sensor(self._model, with_all, memory.change, values, self._fewest, number)
            if odd is not None:
                used, poses, explained = there.copy(), odd.poses, True
                used[odd.sensor] = False
                memory.left_out, memory.agrees_frames = odd.sensor, 0
        if not explained:
            self._touch.unseen()
            memory.unexplained += search != "due"
            told = reasons.poses_not_searched if search == "due" else reasons.unexplained_by_poses
            return PosesReading("disturbed", told(poses.chi2), used, search=search)
        left_out = memory.left_out
        if left_out >= 0 and odd is None:
            self._try_again(measured, there, poses)
        memory.unexplained, memory.change, memory.ambient_t = 0, poses.change, poses.ambient_t
        memory.now_t = np.abs(measured.field_t - poses.misfit_t)
        memory.recovery.recent_t = np.maximum(memory.recovery.recent_t, memory.now_t)
        touched = self._touch.update(poses.change, poses.covariance)
        health, reason = reasons.health_of_axes(used, missing, left_out)
        return PosesReading(health, reason, used, poses, touched, search)

    def _solved(self, measured: Measured, used: Mask) -> FreePoses:
        """Starts from the previous frame's poses. χ² has one minimum: from any press, none of 900 others was missed."""
        return free_poses(self._model, self.memory.change, measured.only(used), self._since_rest.around_t)

    def _try_again(self, measured: Measured, there: Mask, poses: FreePoses) -> None:
        """Use a sensor that was left out again, when it has agreed for long enough."""
        again = free_poses(self._model, poses.change, measured.only(there), self._since_rest.around_t)
        note_agreement(self.memory, there, again.chi2 - poses.chi2)
