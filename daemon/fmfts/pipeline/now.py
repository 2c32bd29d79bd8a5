"""`now` of a message: the contact at the time of publishing. pose/motion.py → contact/now.py; fast/now.c does the same.

The time comes from the frame's number and the board's clock alone, never from arrivals, so that a replay says the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.common.chi2 import quantile
from fmfts.contact import ContactEstimate, ContactModel, NoContactModel, doubt
from fmfts.contact.drive import Drive, to_pose
from fmfts.contact.now import ContactNow, carried, shrunk
from fmfts.contact.refinement import packed
from fmfts.contact.response import Response
from fmfts.contact.touch import DEGREES_OF_FREEDOM, RELEASE_PROBABILITY, TouchMemory, chi2_from_rest
from fmfts.pad import Array
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.deviations import published_force_sd_n
from fmfts.pipeline.fast.now_parameters import NowParameters
from fmfts.pose import AMBIENT, LOG_MOMENT, PoseEstimate, State, change_from, displacement, tangent_basis
from fmfts.pose.change import shortest_rotation
from fmfts.pose.hidden_gradient import HiddenGradient
from fmfts.pose.motion import (
    AMBIENT_CHANGE,
    FALSE_INNOVATION,
    MOVING,
    POSE,
    RATE,
    MotionFilter,
    MotionMemory,
    Samples,
)
from fmfts.pose.silicone import SiliconeFollower

# Before so many frames the filter has not settled.
SETTLED_FRAMES = 3
# Beyond it (a board that stalls, a chip that stopped) the newest sample says nothing of the time of publishing.
LONGEST_LEAD_S = 0.02
# A frame is made just after its newest conversion, at best: the latest of the recent frames tells when. What it tells
# is let go by this share of a period each frame, so that a board with another rate than it should have is followed.
LET_GO = 0.0025
JUMP_PERIODS = 2.5


class Lead(NamedTuple):
    """frame_s: from when a board makes a frame to when its message is published. early_s: from when a chip has a sample
    that comes before its frame; 0: only frames are published."""

    frame_s: float = 0.0
    early_s: float = 0.0


class Taken(NamedTuple):
    """The newest sample of each chip, as measured: field_t (N, 3), time_us (N,), fresh (N,); and the frame's number and
    time: `Frame.sequence`, `Frame.device_time_us`."""

    field_t: Array
    time_us: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    sequence: int
    device_time_us: int


class Early(NamedTuple):
    """One chip's sample that came before its frame: field_t (3,) as measured, NaN where an axis holds no measurement;
    time_us on the board's clock."""

    sensor: int
    field_t: Array
    time_us: int


@dataclass(slots=True)
class NowMemory:
    """made_us: when frame 0 would have been made, on the board's clock, as far as recent frames tell. told_us: the time
    that the last message was about."""

    motion: MotionMemory
    made_us: float = 0.0
    told_us: float = 0.0


@dataclass(frozen=True, slots=True)
class _Judged:
    """What the last frame says of the samples that come before the next. newest_us (N,): of the frame's samples.

    beyond: the contact is beyond what its model knows. ambient_t (N, 3): of the estimate, in sensor axes.
    """

    estimate: PoseEstimate
    touch: TouchMemory
    beyond: bool
    detection_limit_n: float
    drive: Array
    ambient_t: Array
    newest_us: NDArray[np.int64]


class NowEstimator:
    """The contact at the time of publishing, of one pad with a baseline.

    lead: how old frames and samples are when their messages are published.
    """

    def __init__(
        self,
        baselined: BaselinedPad,
        model: ContactModel,
        silicone: SiliconeFollower,
        hidden_gradient: HiddenGradient,
        response: Response,
        rate_hz: float,
        lead: Lead,
    ) -> None:
        self._baselined, self._model = baselined, model
        self._silicone, self._hidden_gradient = silicone, hidden_gradient
        mounting, walk = baselined.mounting, baselined.tracking.walk_per_s[AMBIENT]
        turn = shortest_rotation(mounting.rest.axis, baselined.drawing.rest_axis)
        to_the_pose = to_pose(product(turn, tangent_basis(mounting.rest.axis))[:2])
        self._drive = Drive(response, to_the_pose)
        self._rest_chi2 = quantile(RELEASE_PROBABILITY, DEGREES_OF_FREEDOM)
        surprise_chi2 = quantile(FALSE_INNOVATION, mounting.noise_t.size)
        early_chi2 = quantile(FALSE_INNOVATION, 3)
        self._filter = MotionFilter(baselined.pad, mounting.rest, mounting.noise_t, walk, surprise_chi2, early_chi2)
        self._memory = NowMemory(self._filter.memory)
        self._judged: _Judged | None = None  # by the last frame, while the filter runs
        self.parameters = NowParameters(
            response=packed(response),
            to_pose=to_the_pose,
            untouched_drive=self._drive.untouched,
            surprise_chi2=surprise_chi2,
            early_chi2=early_chi2,
            period_us=1e6 / rate_hz,
            lead_us=1e6 * lead.frame_s,
            early_lead_us=1e6 * lead.early_s,
            let_go=LET_GO,
            jump_periods=JUMP_PERIODS,
            settled_frames=SETTLED_FRAMES,
            longest_lead_s=LONGEST_LEAD_S,
        )

    @classmethod
    def of(
        cls,
        baselined: BaselinedPad,
        model: ContactModel | NoContactModel,
        silicone: SiliconeFollower,
        hidden_gradient: HiddenGradient,
        rate_hz: float,
        lead: Lead,
    ) -> NowEstimator | None:
        """silicone, hidden_gradient: follow this pad. None if the pad's response, or its rest, is not known."""
        if isinstance(model, NoContactModel) or model.response is None or not baselined.at_rest:
            return None
        response = model.response if model.has_shear else model.response.without_shear()
        return cls(baselined, model, silicone, hidden_gradient, response, rate_hz, lead)

    @property
    def memory(self) -> NowMemory:
        return self._memory

    @memory.setter
    def memory(self, memory: NowMemory) -> None:
        self._memory, self._filter.memory = memory, memory.motion

    @property
    def runs(self) -> bool:
        """Whether the next frame may continue in C."""
        return self.memory.motion.motion_us > 0.0 and self.memory.motion.followed >= SETTLED_FRAMES

    def forget(self) -> None:
        self._filter.forget()
        self._judged = None

    def taken_back(self) -> None:
        """C judged the last frame: what this estimator knew of an earlier one holds no longer."""
        self._judged = None

    def update(
        self,
        taken: Taken,
        aligned_us: int,
        estimate: PoseEstimate,
        contact: ContactEstimate,
        touch: TouchMemory,
        detection_limit_n: float,
    ) -> ContactNow | None:
        """Follow a healthy frame. None where the contact at the time of publishing is not known.

        estimate, contact, touch: of this frame, at `aligned_us`.
        """
        publish_us, mounting = self._publish_us(taken), self._baselined.mounting
        ambient_t = self._baselined.pad.sensors.to_sensor(np.tile(estimate.state.ambient_t, (len(taken.fresh), 1)))
        memory, drive = self._filter.memory, self._drive.at(contact if touch.in_contact else None)
        if memory.motion_us == 0.0:
            change = change_from(mounting.rest, estimate)
            self._filter.begin(aligned_us, change, estimate.state, estimate.covariance, drive)
        field_t = mounting.magnet_field(taken.field_t)
        samples = Samples(field_t, mounting.lasting_deviation_t(field_t, ambient_t), taken.time_us, taken.fresh)
        follows = self._filter.follow(samples, estimate.state.log_moment, drive)
        beyond = touch.in_contact and (contact.over_range or contact.refused)
        self._judged = None
        if not follows:
            return None
        newest_us = taken.time_us.copy()
        self._judged = _Judged(estimate, touch, beyond, detection_limit_n, drive, ambient_t, newest_us)
        return self._told(self._judged, publish_us)

    def early(self, early: Early) -> ContactNow | None:
        """Follow a sample that came before its frame. None where it is not used, or contradicts what was predicted, or
        where the contact at the time of publishing is not known."""
        judged = self._judged
        if self.parameters.early_lead_us <= 0.0 or judged is None or not np.isfinite(early.field_t).all():
            return None
        ahead_us = early.time_us - int(judged.newest_us.max())
        if not self._filter.is_next(early.sensor, early.time_us) or early.time_us <= judged.newest_us[early.sensor]:
            return None
        if ahead_us > LONGEST_LEAD_S * 1e6:
            return None
        taken, time_us = np.full(judged.ambient_t.shape, np.nan), judged.newest_us.copy()
        taken[early.sensor], time_us[early.sensor] = early.field_t, early.time_us
        field_t = self._baselined.mounting.magnet_field(taken)
        deviation_t = self._baselined.mounting.lasting_deviation_t(field_t, judged.ambient_t)
        samples = Samples(field_t, deviation_t, time_us, np.zeros(len(time_us), dtype=np.bool_))
        if not self._filter.follow_early(samples, early.sensor, judged.estimate.state.log_moment, judged.drive):
            self._judged = None
            return None
        return self._told(judged, max(early.time_us + self.parameters.early_lead_us, self.memory.told_us))

    def _told(self, judged: _Judged, publish_us: float) -> ContactNow | None:
        """The contact at `publish_us`, if it is known."""
        memory = self._filter.memory
        lead_s = (publish_us - memory.motion_us) * 1e-6
        if judged.beyond or memory.followed < SETTLED_FRAMES or not 0.0 <= lead_s <= LONGEST_LEAD_S:
            return None
        self.memory.told_us = publish_us
        if not (np.diagonal(memory.motion_covariance) >= 0.0).all():
            return None
        now = self._ahead(judged.estimate, judged.touch, judged.detection_limit_n, publish_us, lead_s)
        return now if now is not None and now.is_finite else None

    def _publish_us(self, taken: Taken) -> float:
        """When the frame's message is published, on the board's clock."""
        period_us = self.parameters.period_us
        first_us = taken.device_time_us - taken.sequence * period_us
        made_us = max(self.memory.made_us - LET_GO * period_us, first_us)
        if made_us - first_us > JUMP_PERIODS * period_us:  # the board was reset
            made_us = first_us
        self.memory.made_us = made_us
        return made_us + taken.sequence * period_us + self.parameters.lead_us

    def _ahead(
        self, estimate: PoseEstimate, touch: TouchMemory, detection_limit_n: float, publish_us: float, lead_s: float
    ) -> ContactNow | None:
        baselined, memory = self._baselined, self._filter.memory
        moving = self._at_newest(estimate)
        of_silicone = self._silicone.covariance(change_from(baselined.mounting.rest, moving))
        moving = baselined.with_calibration_uncertainty(self._hidden_gradient.widened(moving), of_silicone)
        chi2 = chi2_from_rest(*displacement(moving, baselined.mounting.rest))
        position_m, axis, covariance = baselined.in_nominal_frame(moving)
        contact = self._model.estimate(position_m, axis, covariance, baselined.magnet_off_m)
        if touch.in_contact and (contact.over_range or contact.refused):  # of the filter's pose
            return None
        turn = shortest_rotation(baselined.mounting.rest.axis, baselined.drawing.rest_axis)
        by_pose = np.zeros((6, 5))
        by_pose[:3, :3] = np.eye(3)
        by_pose[3:, 3:] = product(turn, tangent_basis(moving.axis))
        slope = product(self._model.slope(), by_pose)
        variance = np.diagonal(product(slope, memory.motion_covariance[RATE, RATE], slope.T))
        rates, rate_sd = shrunk(product(slope, memory.motion_state[RATE]), variance, float(memory.modes[MOVING]))
        values, deviations = contact.values, np.sqrt(np.diagonal(contact.covariance))
        deviations[2] = published_force_sd_n(contact, touch, detection_limit_n)
        # No finger lifts the magnet. Near rest, noise and what the baseline leaves unknown look like corner presses. In
        # a contact the message has a force already, and both say the same.
        is_certain = touch.in_contact or doubt(contact.force_n, square(contact.force_sd_n)) < 1.0
        pressed = bool(memory.motion_state[2] < 0.0) and chi2 is not None and chi2 > self._rest_chi2 and is_certain
        return carried(publish_us, lead_s, values, deviations, rates, rate_sd, pressed, touch.in_contact)

    def _at_newest(self, estimate: PoseEstimate) -> PoseEstimate:
        """The filter's pose in the form of the solver's. What the moment leaves uncertain is taken over from that."""
        memory, solved = self._filter.memory, estimate.covariance
        position_m, axis, _ = self._filter.pose(memory.motion_state[POSE])
        by_moment = solved[:5, LOG_MOMENT]
        covariance = np.zeros(solved.shape)
        covariance[:5, :5] = memory.motion_covariance[POSE, POSE]
        if solved[LOG_MOMENT, LOG_MOMENT] > 0.0:
            covariance[:5, :5] += np.outer(by_moment, by_moment) / solved[LOG_MOMENT, LOG_MOMENT]
        covariance[AMBIENT, AMBIENT] = memory.motion_covariance[AMBIENT_CHANGE, AMBIENT_CHANGE]
        state = State(position_m, axis, estimate.state.log_moment, memory.motion_state[AMBIENT_CHANGE])
        return replace(estimate, state=state, covariance=covariance)
