"""One pad that has a baseline: field → pose → contact. Each step runs only if the one before can be trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.contact import ContactModel, NoContactModel, Smoother, TouchDetector
from fmfts.contact.now import ContactNow
from fmfts.contact.smoothing import SmootherMemory
from fmfts.contact.touch import TouchMemory
from fmfts.pad import Array
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.deviations import published_force_sd_n
from fmfts.pipeline.fast import FastPath, Missing
from fmfts.pipeline.hidden_force import hidden_force_n
from fmfts.pipeline.now import Early, Lead, NowEstimator, NowMemory, Taken
from fmfts.pipeline.reading import JUMPED, Reading, degraded, held, without_model
from fmfts.pose import Aligned, Alignment, displacement
from fmfts.pose.alignment import has_jumped
from fmfts.pose.ambient_motion import AmbientMotionMemory
from fmfts.pose.change import change_from, distance
from fmfts.pose.hidden_gradient import HiddenGradientMemory
from fmfts.pose.neighbour import NeighbourEstimate, NeighbourView, placement_deviation, with_rest
from fmfts.pose.overlap import overlap
from fmfts.pose.residual_monitor import FEWEST_SENSORS
from fmfts.pose.sighting import Sighting
from fmfts.pose.silicone import SiliconeFollower, SiliconeMemory
from fmfts.pose.track import Track, TrackerMemory
from fmfts.pose.tracker import NOTHING_SAID

BARE_ONLY = "rest not recorded: mount the pad, then `fmfts-daemon baseline --rest` while nothing touches it"
# A finger never lifts the magnet. If the magnet stays lifted for this long, its baseline was recorded under load.
LIFTED_S = 0.6
# Something that pulls at the pad lifts it too. If the magnet is back at rest for this long, the baseline was good: a
# load that is put on again passes by that place, to within 20 mN, in less time.
RESTED_S = 0.15
PULLED = "the magnet is {:.2f} mm above its rest: something pulls at the pad, or its baseline was recorded under load"
# A board warms by 20 K in ten minutes. So within this time the last temperature is off by a fifth of a kelvin at most.
HELD_S = 5.0


@dataclass(slots=True)
class EstimatorMemory:
    """last_us: the board's time of the last frame, None before the first. lifted_s: how long the magnet has been above
    its rest. rested_s: how long it has been at rest since. unread_s: how long an earlier frame's temperature is held.
    now: None of a pad whose response is not known, and of recordings that are older than `now`.
    """

    tracker: TrackerMemory
    touch: TouchMemory
    smoother: SmootherMemory
    ambient_motion: AmbientMotionMemory | None
    last_us: int | None = None
    lifted_s: float = 0.0
    rested_s: float = 0.0
    unread_s: float = 0.0
    now: NowMemory | None = None
    # Recordings of old versions lack these.
    silicone: SiliconeMemory = field(default_factory=SiliconeMemory)
    hidden_gradient: HiddenGradientMemory = field(default_factory=HiddenGradientMemory)
    warmed_k: float = 0.0


class Estimator:
    """Field → pose → contact of a pad that has a baseline."""

    def __init__(
        self,
        baselined: BaselinedPad,
        model: ContactModel | NoContactModel,
        rate_hz: float,
        stopped_us: float,
        lead: Lead,
    ) -> None:
        self.baselined = baselined
        self.baseline = baselined.baseline
        self.mounting = baselined.mounting
        self._model = model
        self._tracker = baselined.tracker()
        self._ambient_motion = baselined.ambient_motion()
        self._hidden_gradient = baselined.hidden_gradient()
        hidden_n = hidden_force_n(baselined, self._hidden_gradient, model)
        self._touch = TouchDetector(rate_hz, hidden_force_sd_n=hidden_n)
        self._silicone = SiliconeFollower(baselined.drawing.silicone, self._touch.longest_gap_s)
        self._smoother = Smoother(model.smoothing_s)
        ambient_motion = None if self._ambient_motion is None else self._ambient_motion.memory
        self.memory = EstimatorMemory(
            *(self._tracker.memory, self._touch.memory, self._smoother.memory, ambient_motion),
            silicone=self._silicone.memory,
            hidden_gradient=self._hidden_gradient.memory,
        )
        self._now = NowEstimator.of(baselined, model, self._silicone, self._hidden_gradient, rate_hz, lead)
        if self._now is not None:
            self.memory.now = self._now.memory
        self.detection_limit_n = 0.0
        self._path: FastPath | None = None
        resting = baselined.resting_covariance()
        if resting is not None and isinstance(model, ContactModel):
            self.detection_limit_n = model.detection_limit_n(resting, self._touch.onset_chi2)
        if baselined.at_rest:
            self._path = FastPath.of(
                baselined.drawing,
                baselined.mounting,
                baselined.tracking,
                baselined.temperature_c,
                model,
                self._touch,
                self._silicone,
                self._hidden_gradient,
                baselined.change_error,
                baselined.repeats_allowed,
                stopped_us,
                self.detection_limit_n,
                None if self._now is None else self._now.parameters,
            )

    def hand_over(
        self,
        alignment: Alignment,
        reading: Reading,
        missing: Missing,
        gain_code: int,
        own: Sighting,
        neighbours: Sequence[NeighbourView],
    ) -> FastPath | None:
        """Give the memory to the compiled path, and return that path. None if only Python can judge the next frame.

        reading, missing, gain_code: of the last frame. C goes on while the same is missing. own: where C tells that the
        magnet was seen; neighbours: the pads that are felt.
        """
        is_whole, blamed = reading.health == "ok", self._tracker.blamed
        if blamed is not None:
            if missing.gain_code >= 0 or len(missing.silent) <= FEWEST_SENSORS:
                return None
            motion = self._ambient_motion
            missing = missing.without(blamed, gain_code, np.inf if motion is None else motion.frames_before_look)
        if not reading.is_steady or (reading.used != missing.used).any():
            return None  # what is missing is not all that is wrong: a sensor at odds with the others, or stuck
        if (
            self._path is None
            or self.memory.last_us is None
            or self.memory.lifted_s > 0.0
            or self.memory.unread_s > 0.0
        ):
            return None
        if self._ambient_motion is not None and self._ambient_motion.is_moving:
            return None
        if self._model.smoothing_s > 0.0 and self.memory.smoother.pose is None:
            return None
        begins_now = self._now is not None and not self._now.runs and not neighbours
        if not self._tracker.can_be_handed_over or (is_whole and begins_now):
            return None
        if alignment.memory.without_news or not self._path.be_among(own, neighbours):
            return None
        self._path.take_over(missing, reading.health, reading.reason, alignment.memory, self.memory)
        return self._path

    def take_back(self, path: FastPath, alignment: Alignment) -> None:
        """Take the memory back from the compiled path."""
        path.give_back(alignment.memory, self.memory)
        if self._now is not None:
            self._now.taken_back()
        self._tracker.resumed(path.was_sound)
        if self._ambient_motion is not None:
            self._ambient_motion.passed(path.passed, were_ok=path.verdict.health == "ok")

    def recall(self, memory: EstimatorMemory) -> None:
        """Go on from the memory of another estimator of the same pad, baseline and scene."""
        self.memory = memory
        self._tracker.recall(memory.tracker)
        self._touch.memory, self._smoother.memory = memory.touch, memory.smoother
        self._silicone.memory, self._hidden_gradient.memory = memory.silicone, memory.hidden_gradient
        if self._ambient_motion is not None and memory.ambient_motion is not None:
            self._ambient_motion.memory = memory.ambient_motion
        if self._now is not None and memory.now is not None:
            self._now.memory = memory.now

    def _follow_lift(self, lifted: bool, resting: bool, elapsed_s: float) -> None:
        """Count for how long the magnet is above its rest, and then, for how long it has been back at rest.

        A press that brings a magnet exactly there, where a baseline under load found it, does not hold it there.
        """
        memory = self.memory
        memory.rested_s = memory.rested_s + elapsed_s if memory.lifted_s > 0.0 and resting and not lifted else 0.0
        if lifted:
            memory.lifted_s += elapsed_s
        elif memory.lifted_s < LIFTED_S or memory.rested_s >= RESTED_S:
            memory.lifted_s = memory.rested_s = 0.0

    def _follow_thermometer(self, temperature_c: float | None, elapsed_s: float) -> None:
        """Count how long an earlier temperature is held. Before the first one, its error is in every deviation."""
        tracking, held = self.baselined.tracking, self._tracker.memory.unread_variance == 0.0
        matters = tracking.unread_warming_k > 0.0 and self.baselined.temperature_c is not None
        self.memory.unread_s = self.memory.unread_s + elapsed_s if temperature_c is None and matters and held else 0.0

    def _drift_t(self, temperature_c: float | None) -> float:
        """Deviation (T) of what the offset of each axis has drifted since rest, by the last temperature told."""
        if temperature_c is not None and self.baselined.temperature_c is not None:
            self.memory.warmed_k = temperature_c - self.baselined.temperature_c
        return abs(self.baselined.tracking.offset_t_per_k * self.memory.warmed_k)

    def forget_touch(self) -> None:
        """Treat the pad as untouched until the next onset."""
        self._touch.forget()
        self._forget_now()

    def early(self, early: Early) -> ContactNow | None:
        """What a sample that came before its frame says; None where it says nothing new."""
        return None if self._now is None else self._now.early(early)

    def tell_no_now(self) -> None:
        """From now on, no message tells the contact at the time of publishing."""
        self._now = self.memory.now = None
        if self._path is not None:
            self._path.tell_no_now()

    def _forget_now(self) -> None:
        if self._now is not None:
            self._now.forget()

    def read(
        self,
        aligned: Aligned,
        temperature_c: float | None,
        neighbours: Sequence[NeighbourEstimate] = (),
        missing: Mapping[int, str] = NOTHING_SAID,
        taken: Taken | None = None,
    ) -> Reading:
        """Judge one aligned frame. neighbours: the felt magnets of other pads at the time of this frame.

        missing: what is wrong with sensors that cannot be used, for the reason. taken: the frame's own samples, for
        what holds at the time of publishing.
        """
        reading = self._read(aligned, temperature_c, neighbours, missing)
        estimate, contact, touching = reading.estimate, reading.contact, reading.touching
        healthy = reading.health == "ok" and not neighbours
        if self._now is None:
            return reading
        if not healthy or taken is None or estimate is None or contact is None or touching is None:
            self._now.forget()
            return reading
        touch = replace(self._touch.memory)
        now = self._now.update(taken, aligned.time_us, estimate, contact, touch, self.detection_limit_n)
        return replace(reading, now=now)

    def _read(
        self,
        aligned: Aligned,
        temperature_c: float | None,
        neighbours: Sequence[NeighbourEstimate],
        missing: Mapping[int, str],
    ) -> Reading:
        memory = self.memory
        elapsed_s = aligned.elapsed_s(memory.last_us)
        memory.last_us = aligned.time_us
        if aligned.began_anew:
            self._touch.forget()  # nobody knows for how long nothing was seen: the finger may be gone
        if aligned.leap_us:
            self._forget_now()
        self._silicone.passed(elapsed_s)
        not_stuck = aligned.repeats <= self.baselined.repeats_allowed
        field = self.mounting.magnet_field(np.where(not_stuck, aligned.field_t, np.nan))
        lasting, elsewhere = self.mounting.lasting_deviation_t(field, self._tracker.ambient_t), aligned.bend_t
        drift_t = self._drift_t(temperature_c)
        if drift_t > 0.0:
            elsewhere = root_of_squares(elsewhere, drift_t)
        if neighbours:
            field = with_rest(field, self.baselined.pad.sensors, neighbours)
            elsewhere = root_of_squares(elsewhere, placement_deviation(self.baselined.pad.sensors, neighbours))
        noise = self.mounting.noise_t * aligned.noise_share
        deviation = np.sqrt(square(lasting) + square(elsewhere) + square(noise))
        track = self._tracker.update(field, deviation, elapsed_s, temperature_c, elsewhere, neighbours, missing)
        if self._ambient_motion is not None:
            track = self._ambient_motion.judge(track, field, deviation)
        if not self.baselined.at_rest:
            return Reading("no_baseline", BARE_ONLY, track.used, track.estimate)
        track = self._hidden_gradient.judge(track, elapsed_s, neighbours)
        if track.estimate is None or track.health == "disturbed":
            self._touch.unseen()
            memory.rested_s = 0.0
            return Reading(track.health, track.reason, track.used)
        self._follow_thermometer(temperature_c, elapsed_s)
        if elapsed_s > self._touch.longest_gap_s:
            self._touch.forget()
        of_silicone = self._silicone.update(change_from(self.mounting.rest, track.estimate))
        counted = self._counted(track, deviation, lasting, neighbours)
        estimate = self.baselined.with_calibration_uncertainty(track.estimate, of_silicone, counted)
        change, covariance = displacement(estimate, self.mounting.rest)
        touched = self._touch.update(change, covariance)
        if memory.unread_s > HELD_S:
            track = held(track, memory.unread_s)
        if isinstance(self._model, NoContactModel):
            return without_model(self._model, track, touched, distance(change, covariance))
        # The contact model was trained on the pad as drawn.
        pose = self._smoother.update(*self.baselined.in_nominal_frame(estimate), elapsed_s)
        contact = self._model.estimate(*pose, self.baselined.magnet_off_m)
        self._follow_lift(contact.lifted_m > 0.0, touched is False, elapsed_s)
        if memory.lifted_s >= LIFTED_S:
            return Reading("no_baseline", self.baselined.lifted_reason, track.used, track.estimate)
        if contact.lifted_m > 0.0:
            self._touch.forget()
            return Reading("disturbed", PULLED.format(contact.lifted_m * 1e3), track.used, track.estimate)
        touching = None if touched is None else self._touch.presses(contact)
        if touching and contact.over_range and has_jumped(aligned):
            track = degraded(track, JUMPED)
        force_sd_n = published_force_sd_n(contact, self._touch.memory, self.detection_limit_n)
        return Reading(
            *(track.health, track.reason, track.used, track.estimate, contact, touching, force_sd_n),
            is_steady=track.is_steady,
        )

    def _counted(
        self, track: Track, deviation_t: Array, lasting_t: Array, neighbours: Sequence[NeighbourEstimate]
    ) -> Array | None:
        """The part of the frame's covariance that the baseline's leftovers count, too; None where it is not known.

        The leftovers are those of a solution from all sensors and without neighbours: another one keeps both.
        """
        if track.estimate is None or neighbours or not track.used.all():
            return None
        baselined, covariance = self.baselined, self._tracker.memory.covariance  # not widened by misfit
        return overlap(
            baselined.pad, track.estimate.state, covariance, baselined.tracking.parts, deviation_t, lasting_t
        )
