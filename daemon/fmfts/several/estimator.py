"""One pad with several magnets that has a baseline: field → fingers. Each step runs only if the one before is sound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import SingularError
from fmfts.pose import Aligned
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.pose.neighbour import NeighbourEstimate
from fmfts.pose.observable import needed_values
from fmfts.pose.state import Neighbour
from fmfts.several import reasons, searches
from fmfts.several.count import MOST_FINGERS, RELEASE_FRAMES, CounterMemory, FingerCounter, Search
from fmfts.several.field_model import FINGER, FieldModel
from fmfts.several.fit import BEYOND, UNDETERMINED, Fit, Fitter, Measured, limit
from fmfts.several.free_poses import FreePoses, free_poses, is_explained
from fmfts.several.hidden import hidden_variance
from fmfts.several.odd_sensor import FEWEST_VALUES, UNEXPLAINED, Odd, is_odd, note_agreement, odd_sensor
from fmfts.several.poses import UNFELT, Poses, poses_of
from fmfts.several.reading import FingersMemory, FingersReading, Seen
from fmfts.several.recovery import Recovery
from fmfts.several.scan import Another
from fmfts.several.sighted import sighted
from fmfts.several.since_rest import CONSTANT, SinceRest, Warmth, begun
from fmfts.several.trust import trusted
from fmfts.several.valley import LIMITS, valley_variance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A third finger is searched if χ² exceeds that of this share of healthy frames, and accepted if it lowers χ² by this:
# none of 1,200 healthy frames of two fingers has such a place.
SUSPICIOUS, THIRD_GAIN = 0.02, 20.0
# One finger is doubtful if χ² is this large and a second finger would lower it by this: too little to report two, but
# only one in ten thousand frames of one finger has it (lab/results/several.md).
DOUBTED, DOUBTED_GAIN = 0.005, 20.0
# A hidden second finger is searched in the half of the healthy frames with the larger χ².
EXPLAINED_WELL = 0.5
# A third finger is gone when two explain this many frames in a row: by chance two sometimes explain a frame of three.
GONE_FRAMES = 10
# A gap after which fingers are searched anew.
LONGEST_GAP_S = 0.05


class FingersEstimator:
    """Field → fingers of a pad that has a baseline.

    repeats_allowed (N, 3): of an axis that is not stuck. since_rest: of the last frame, also for C.
    """

    def __init__(self, model: FieldModel, rate_hz: float, repeats_allowed: Array, warmth: Warmth = CONSTANT) -> None:
        pad, mounting = model.pad, model.mounting
        self.pad, self.mounting, self.response, self.scene = pad, mounting, model.response, model.scene
        self.rate_hz, self.repeats_allowed = rate_hz, repeats_allowed
        self.since_rest = SinceRest(pad, mounting, repeats_allowed, warmth)
        self.silicone = self.since_rest.silicone
        self._longest_gap_s = max(LONGEST_GAP_S, (RELEASE_FRAMES + 0.5) / rate_hz)
        self.fitter = Fitter(model)
        self._counter = FingerCounter(self.fitter, rate_hz)
        healthy = enumerate((UNEXPLAINED, EXPLAINED_WELL, SUSPICIOUS))  # with no finger, one, or two
        limits = [limit(share, mounting.gain.size, fingers) for fingers, share in healthy]
        # Of a calm frame, as ordinary.h has them.
        self.calm_limits = np.array([*np.minimum(limits, self._counter.searched_from), *LIMITS, *UNFELT])
        self._cold = FingerCounter(self.fitter, rate_hz)
        self._rest_c = warmth.rest_c
        self.start_anew()
        self.unfelt_variance = np.tile(square(UNFELT), (len(mounting.magnets), 1))
        self._poses: tuple[FingersReading, Poses] | None = None  # of the last requested reading
        self._values_for_poses = needed_values(len(pad.magnets))
        # Of a force of zero: the largest force that goes undetected at the least sensitive place.
        self.quiet_force_sd_n = self._counter.detection_limit_n(mounting.noise_t / mounting.gain) / sqrt(3.0)

    def poses(self, reading: FingersReading) -> tuple[Magnets, Array]:
        """The magnets of the last frame, and the variances (M, 5) of their changes since rest: from the fingers'
        uncertainty, and from other causes (several/poses.py)."""
        fit = reading.fit
        if fit is None or reading.measured is None or not len(fit.fingers):
            return self.mounting.magnets, self.unfelt_variance
        poses = self._poses_of(reading, fit, reading.measured, False)
        return poses.magnets, poses.variance

    def recall(self, memory: FingersMemory) -> None:
        """Go on from the memory of another estimator of the same pad, baseline and scene."""
        self.memory = memory
        self._remember(memory.counter)

    def start_anew(self) -> None:
        """Forget all frames; earlier fingers keep their ids."""
        counter = CounterMemory(next_id=self._counter.memory.next_id)
        self.recall(FingersMemory(Recovery(np.zeros(self.mounting.gain.size)), last_c=self._rest_c, counter=counter))

    def forget_touch(self) -> None:
        self._counter.forget()

    def sighted(self, reading: FingersReading) -> tuple[tuple[Neighbour, ...], Array] | None:
        """The magnets in the last frame, and the covariance (6M, 6M) of a step from there; None if not known."""
        poses: Poses | FreePoses | None = reading.free
        if reading.fit is not None and reading.measured is not None and not reading.over_range:
            poses = self._poses_of(reading, reading.fit, reading.measured, True)
        if poses is None:
            return None
        return sighted(self.mounting, poses, self.since_rest.moment, self.scene.moment)

    def _poses_of(self, reading: FingersReading, fit: Fit, measured: Measured, for_neighbours: bool) -> Poses:
        """Computed once a frame: for neighbouring pads, which need its covariance, before its message."""
        if self._poses is None or self._poses[0] is not reading:
            self._poses = reading, poses_of(self.fitter, fit, measured, self.since_rest.around_t, for_neighbours)
        return self._poses[1]

    def begin(self, aligned: Aligned, temperature_c: float | None) -> None:
        """Of each frame, before anything else."""
        memory = self.memory
        elapsed_s = begun(aligned, memory, self._longest_gap_s, self._counter.forget)
        memory.recovery.pass_time(elapsed_s, pressed=memory.counter.count > 0)
        self.since_rest.begin(temperature_c, memory, elapsed_s)

    def goes_on(self, fingers: Array, ambient_t: Array) -> None:
        """The same fingers press as in the last frame, which was calm."""
        memory, ids = self.memory, self.memory.counter.known
        memory.counter.put(fingers, ids, ids)
        memory.counter.doubtful_frames, memory.ambient_t = 0, ambient_t

    def read(
        self,
        aligned: Aligned,
        temperature_c: float | None,
        missing: Mapping[int, str],
        neighbours: Sequence[NeighbourEstimate] = (),
        may_search: bool = True,
    ) -> FingersReading:
        """Judge one aligned frame. missing: what is wrong with sensors that cannot be used. neighbours: the magnets of
        other pads at the time of this frame. may_search: it may search for fingers, which takes long."""
        self.begin(aligned, temperature_c)
        return self.look(self.seen(aligned, neighbours), missing, may_search)

    def seen(self, aligned: Aligned, neighbours: Sequence[NeighbourEstimate] = ()) -> Seen:
        """What a frame says that C has not looked at, after `begin`."""
        memory, fingers = self.memory, self.memory.counter.fingers
        now_t = self.fitter.model.predict(fingers).field_t if len(fingers) else None
        return Seen(*self.since_rest.measured(aligned, neighbours, memory, now_t))

    def look(self, seen: Seen, missing: Mapping[int, str], may_search: bool) -> FingersReading:
        """A closer look at a frame. The arguments are those of `read`."""
        memory, (measured, jumped, fit) = self.memory, seen
        used = there = measured.used.reshape(-1, 3)
        if memory.left_out >= 0:
            used = there.copy()
            used[memory.left_out] = False
        if np.count_nonzero(used) < FEWEST_VALUES:
            self._counter.forget()
            return FingersReading("lost", reasons.too_few(missing, used), used)
        try:
            reading = self._judged(measured, used, there, missing, may_search, fit)
        except SingularError:
            self._counter.forget()
            return FingersReading("lost", reasons.UNDETERMINED, used)
        return trusted(reading, memory, jumped)

    def _judged(
        self,
        measured: Measured,
        used: Mask,
        there: Mask,
        missing: Mapping[int, str],
        may_search: bool,
        before_fit: Fit | None,
    ) -> FingersReading:
        """before_fit: of the fingers of the last frame, where it is known."""
        memory = self.memory
        # A search takes long, and steel that lies beside the pad would make it each frame.
        is_searched, number = searches.is_searched(memory.unexplained), searches.number_of(memory.unexplained)
        if not (is_searched or memory.more):
            nobody = self.fitter.fit(np.zeros((0, FINGER)), measured.only(used), self.since_rest.around_t)
            if nobody.chi2 > nobody.limit(UNEXPLAINED):
                reading = self._unexplained(nobody, self._free_poses(measured, used), used)
                return reading if reading.free is None else reading._replace(reason=reasons.NOT_SEARCHED_PRESS)
        before = memory.counter.copy()
        for_finger = may_search and (number % 2 == 0 or not is_searched)
        seen = measured.only(used)
        counted = self._counter.update(seen, self.since_rest.around_t, for_finger, before_fit)
        fit, explained = counted.fit, counted.fit.chi2 <= counted.fit.limit(UNEXPLAINED)
        odd, search = None, counted.search
        if is_searched and not explained:
            search = "made" if may_search else "due"
            odd = self._odd_sensor(measured, there, before, number) if may_search else None
        if (search != "due" or memory.more) and self._is_third(fit, seen, odd):
            memory.more = GONE_FRAMES
        elif memory.more:
            memory.more = memory.more - 1 if explained else 0
        is_open = not explained and odd is None and search != "due"
        free = self._free_poses(measured, used) if memory.more or is_open else None
        if memory.more and not explained and free is None and self._tells_poses(used):
            memory.more = 0  # a third finger does not explain it either
        if memory.more:
            memory.unexplained += search != "due"
            return FingersReading("degraded", reasons.THREE, used, ids=counted.ids, more=True, search=search, free=free)
        if search == "due" and not explained:
            self._remember(before)  # continue as if this frame had not come
            return FingersReading("disturbed", reasons.not_searched(fit.chi2), used, search=search)
        if odd is not None:
            used = there.copy()
            used[odd.sensor] = False
            memory.left_out, memory.agrees_frames = odd.sensor, 0
            self._remember(odd.memory)
            seen = measured.only(used)
            counted = self._counter.update(seen, self.since_rest.around_t, may_search=False)
            fit, explained = counted.fit, counted.fit.chi2 <= counted.fit.limit(UNEXPLAINED)
        left_out = memory.left_out
        if odd is None and explained and left_out >= 0:
            self._try_again(measured, there, fit)
        if not explained:
            return self._unexplained(fit, free, used, search)
        if fit.flags & UNDETERMINED:
            raise SingularError("the fingers are not determined")
        memory.unexplained = 0
        memory.ambient_t = fit.ambient_t.copy()
        health, reason = reasons.health_of_axes(used, missing, left_out)
        alone = fit
        over_range, doubt = bool(fit.flags & BEYOND), reasons.SEARCH_IS_DUE if counted.search == "due" else ""
        if len(fit.fingers) == 1 and (another := self._another(fit, seen, EXPLAINED_WELL)) is not None:
            if fit.chi2 > fit.limit(DOUBTED) and float(another.gain.max()) > DOUBTED_GAIN:
                doubt = reasons.MAYBE_TWO
            hidden = np.diag(hidden_variance(fit.fingers[0], another))
            fit = replace(fit, covariance=fit.covariance + hidden)
        if doubt:
            health, reason = "degraded", "; ".join(filter(None, (reason, doubt)))
        least = valley_variance(self.fitter, alone, seen, self.since_rest.around_t) if len(fit.fingers) else None
        return FingersReading(health, reason, used, fit, counted.ids, False, over_range, seen, least, search)

    def refit(self, fingers: Array, measured: Measured) -> Fit:
        """The most likely fingers near these, by other samples than a frame's. Nothing is remembered."""
        return self.fitter.fit(fingers, measured, self.since_rest.around_t)

    def _odd_sensor(self, measured: Measured, there: Mask, before: CounterMemory, number: int) -> Odd | None:
        if number % 2 == 0:
            return odd_sensor(self.fitter, measured, there, self.since_rest.around_t, before)
        self._cold.memory.next_id = self.memory.counter.next_id
        return is_odd(number // 2 % len(there), measured, there, self.since_rest.around_t, self._cold)

    def _remember(self, counter: CounterMemory) -> None:
        self.memory.counter = self._counter.memory = counter

    def _is_third(self, fit: Fit, seen: Measured, odd: Odd | None) -> bool:
        """Whether one more finger explains the residual of two, and better than a faulty sensor does."""
        another = self._another(fit, seen, SUSPICIOUS) if len(fit.fingers) == MOST_FINGERS else None
        gain = 0.0 if another is None else float(another.gain.max())
        return gain > THIRD_GAIN and (odd is None or fit.chi2 - gain < odd.chi2)

    def _another(self, fit: Fit, seen: Measured, suspicious: float) -> Another | None:
        """The gain of one more finger; None if more than `suspicious` of healthy frames have such a χ²."""
        if fit.chi2 <= fit.limit(suspicious):
            return None
        root = self.fitter.whitener(fit.fingers, seen, self.since_rest.around_t)
        return self.fitter.another(root, fit.fingers, seen)

    def _try_again(self, measured: Measured, there: Mask, fit: Fit) -> None:
        """Use a sensor that was left out again, when it has agreed for long enough."""
        again = self.fitter.fit(fit.fingers, measured.only(there), self.since_rest.around_t)
        note_agreement(self.memory, there, again.chi2 - fit.chi2)

    def _unexplained(self, fit: Fit, free: FreePoses | None, used: Mask, search: Search = "none") -> FingersReading:
        self._counter.forget()
        self.memory.unexplained += 1
        if free is not None:
            return FingersReading("degraded", reasons.OTHER_PRESS, used, more=True, search=search, free=free)
        return FingersReading("disturbed", reasons.unexplained(fit.chi2), used, search=search)

    def _tells_poses(self, used: Mask) -> bool:
        """Whether this many values determine the poses without fingers, with enough redundancy for a check."""
        return bool(np.count_nonzero(used) >= self._values_for_poses)

    def _free_poses(self, measured: Measured, used: Mask) -> FreePoses | None:
        """The poses that explain a frame that no fingers explain; None if there are none, or they are unknown."""
        if not self._tells_poses(used):
            return None
        at_rest, seen = np.zeros(CHANGE * len(self.mounting.magnets)), measured.only(used)
        try:
            poses = free_poses(self.fitter.model, at_rest, seen, self.since_rest.around_t)
        except SingularError:
            return None
        return poses if is_explained(poses, used) else None
