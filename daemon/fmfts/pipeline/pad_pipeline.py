"""The whole job: frame → field → pose → contact → message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline import Baseline, Mounting
from fmfts.bus.messages import ContactMessage, Health
from fmfts.contact import ContactModel, Smoother, TouchDetector
from fmfts.pad import Pad, Placement
from fmfts.pipeline.baselined_pad import ZeroedPad
from fmfts.pipeline.contact_message import PackedMessage, Reading, Sender
from fmfts.pipeline.fast import HealthyPath, Lane, Passed
from fmfts.pose import Aligned, Alignment, State, TrackingModel, displacement
from fmfts.pose.neighbour import NeighbourView, Seen, Sighting, placement_deviation, with_rest
from fmfts.sensor import Frame

NO_BASELINE = "no baseline: record one with `fmfts-daemon baseline` while nothing touches the pad"
BARE_ONLY = "rest not recorded: mount the pad, then `fmfts-daemon baseline --rest` while nothing touches it"
# A finger never lifts the magnet. One that stays lifted for this long was pressed when its baseline was recorded.
LIFTED_S = 0.2


class PadPipeline:
    """One pad. `model` serves every pad of the structure; `tracking` is what its scene leaves unknown."""

    def __init__(self, pad: Pad, model: ContactModel, boot: str, rate_hz: float, tracking: TrackingModel) -> None:
        self.pad = pad
        self._model = model
        self._rate_hz = rate_hz
        self._tracking = tracking
        self._alignment = Alignment(len(pad.sensors), period_us=1e6 / rate_hz)
        self._estimator: Estimator | None = None
        self._why_none = NO_BASELINE
        self._sender = Sender(pad.name, boot, model.hash)
        self._compiled: HealthyPath | None = None  # while it holds the memory of the frames before
        self._sighting = Sighting.unseen(pad.magnet, State.at_rest(pad))
        self._neighbours: list[NeighbourView] = []
        self._among_others = False

    @property
    def baseline(self) -> Baseline | None:
        return None if self._estimator is None else self._estimator.baseline

    @property
    def messages(self) -> int:
        """Number of the last one."""
        return self._sender.number

    @property
    def model_hash(self) -> str:
        return self._model.hash

    @property
    def unfelt_n(self) -> float:
        """The largest force somewhere on the pad that is not felt as a touch."""
        return 0.0 if self._estimator is None else self._estimator.unfelt_n

    @property
    def mounting(self) -> Mounting | None:
        return None if self._estimator is None else self._estimator.mounting

    def use(self, baseline: Baseline, mounting: Mounting | None = None) -> Mounting:
        """From the next frame on, subtract this baseline. BaselineError where it does not fit the pad.

        mounting: what follows from it, where that is known already.
        """
        self.hand_back()
        zeroed = ZeroedPad.of(self.pad, baseline, self._tracking, mounting)
        self._estimator = Estimator(zeroed, self._model, self._rate_hz, self._alignment.stopped_us)
        self._sighting.rests(self._estimator.mounting.rest)
        return self._estimator.mounting

    def feel(self, neighbour: PadPipeline, placement: Placement) -> None:
        """From the next frame on, count with the magnet of another pad; `placement`: of that pad in this one's axes."""
        self._neighbours.append(NeighbourView(neighbour._sighting, placement))
        self._among_others = neighbour._among_others = True

    def refuse(self, reason: str) -> None:
        """There is a baseline, and it cannot be used: say why in every message."""
        self._why_none = reason

    def process(self, frame: Frame) -> ContactMessage:
        """One frame in, one message out."""
        answer = self.answer(frame)
        return answer.message if isinstance(answer, PackedMessage) else answer

    def answer(self, frame: Frame) -> ContactMessage | PackedMessage:
        """The same, its message still packed where nothing is wrong: then all of `_judge` was done in C."""
        if self._compiled is not None and self._estimator is not None:
            judged = self._compiled.judge(frame.packed, frame.device_time_us, frame.temperature_c)
            if judged is not None:
                estimator = self._estimator
                return self._sender.packed(self._compiled, judged, frame, estimator.mounting, estimator.baseline)
            self.hand_back()
        return self._judge(frame)

    def begin(self, clock: bytearray, topic: bytes, pad_index: int) -> Lane | None:
        """The same from the board's bytes to the bus, ready for the next frame; None where Python has to see it.

        clock: `DeviceClock.line`. Until `end`, nothing else is to be asked of this pipeline.
        """
        lane = None if self._compiled is None else self._compiled.lane(clock, topic, pad_index)
        return lane if lane is not None and self._sender.begin(lane) else None

    def end(self, lane: Lane) -> tuple[Passed, PackedMessage] | None:
        """What has passed, and its last message; None where nothing has."""
        passed = lane.end()
        return None if passed is None else (passed, self._sender.passed(passed))

    def _judge(self, frame: Frame) -> ContactMessage:
        sampled_us = frame.device_time_us - frame.age_us.astype(np.int64)
        aligned = self._alignment.push(frame.field_t, sampled_us, frame.fresh)
        sampled_ns = frame.host_time_ns - (frame.device_time_us - aligned.time_us) * 1000
        if self._estimator is None:
            reading = Reading("no_baseline", self._why_none, frame.usable)
        else:
            seen = [view.at(sampled_ns) for view in self._neighbours]
            reading = self._estimator.read(aligned, frame.temperature_c, seen)
            if reading.estimate is not None and reading.contact is not None:
                self._sighting.saw(reading.estimate, sampled_ns)
            if reading.health == "ok" and not self._among_others:
                self._compiled = self._estimator.hand_over(self._alignment)
        return self._sender.message(reading, sampled_ns, frame.temperature_c, self.mounting, self.baseline)

    def hand_back(self) -> None:
        """All memory of the frames before is in Python then, until the next healthy frame."""
        if self._compiled is not None and self._estimator is not None:
            self._estimator.take_back(self._compiled, self._alignment)
        self._compiled = None

    def absent(self, health: Health, reason: str) -> ContactMessage:
        """What is published while no frame can be used: silence is not an answer. Who touched may be gone meanwhile."""
        self.hand_back()
        if self._estimator is not None:
            self._estimator.forget_touch()
        reading = Reading(health, reason, np.zeros((len(self.pad.sensors), 3), dtype=np.bool_))
        return self._sender.message(reading, None, None, self.mounting, self.baseline)


class Estimator:
    """Field → pose → contact of a pad that has a baseline."""

    def __init__(self, zeroed: ZeroedPad, model: ContactModel, rate_hz: float, stopped_us: float) -> None:
        self.zeroed = zeroed
        self.baseline = zeroed.baseline
        self.mounting = zeroed.mounting
        self._model = model
        self._tracker = zeroed.tracker()
        self._constancy = zeroed.constancy()
        self._touch = TouchDetector(rate_hz)
        self._smoother = Smoother(model.smoothing_s)
        self._last_us: int | None = None
        self._lifted_s = 0.0
        resting = zeroed.resting_covariance()
        self.unfelt_n = 0.0 if resting is None else model.unfelt_n(resting, self._touch.onset_chi2)
        self._path: HealthyPath | None = None
        if zeroed.at_rest:
            self._path = HealthyPath.of(
                *(zeroed.drawing, zeroed.mounting, zeroed.tracking, zeroed.temperature_c, model, self._touch),
                *(zeroed.change_error, zeroed.repeats_allowed, stopped_us, self.unfelt_n),
            )

    def hand_over(self, alignment: Alignment) -> HealthyPath | None:
        """The compiled path, with what the next frame needs to know; None where only Python can judge it."""
        if self._path is None or self._last_us is None or self._lifted_s > 0.0:
            return None
        if self._constancy is not None and self._constancy.is_moving:
            return None
        return self._path if self._path.take(alignment, self._tracker, self._touch, self._last_us) else None

    def take_back(self, path: HealthyPath, alignment: Alignment) -> None:
        self._last_us = path.give(alignment, self._tracker, self._touch)
        if self._constancy is not None:
            self._constancy.passed(path.passed)

    def forget_touch(self) -> None:
        self._touch.forget()

    def read(self, aligned: Aligned, temperature_c: float | None, neighbours: Sequence[Seen] = ()) -> Reading:
        """Field → pose → contact, as far as each can be believed."""
        elapsed_s = 0.0 if self._last_us is None else max(aligned.time_us - self._last_us, 0) * 1e-6
        self._last_us = aligned.time_us
        lively = aligned.repeats <= self.zeroed.repeats_allowed
        field = self.mounting.magnet_field(np.where(lively, aligned.field_t, np.nan))
        lasting, elsewhere = self.mounting.lasting_deviation_t(field, self._tracker.ambient_t), aligned.bend_t
        if neighbours:
            field = with_rest(field, self.zeroed.pad.sensors, neighbours)
            elsewhere = root_of_squares(elsewhere, placement_deviation(self.zeroed.pad.sensors, neighbours))
        noise = self.mounting.noise_t * aligned.noise_share
        deviation = np.sqrt(square(lasting) + square(elsewhere) + square(noise))
        track = self._tracker.update(field, deviation, elapsed_s, temperature_c, elsewhere, neighbours)
        if self._constancy is not None:
            track = self._constancy.judge(track, field, deviation)
        if not self.zeroed.at_rest:
            return Reading("no_baseline", BARE_ONLY, track.used, track.estimate)
        if track.estimate is None or track.health == "disturbed":
            self._touch.unseen()
            return Reading(track.health, track.reason, track.used)
        if elapsed_s > self._touch.longest_gap_s:
            self._touch.forget()
        estimate = self.zeroed.honest(track.estimate)
        touching = self._touch.update(*displacement(estimate, self.mounting.rest))
        # The model knows the drawing's pad.
        contact = self._model.estimate(*self._smoother.update(*self.zeroed.as_drawn(estimate), elapsed_s))
        if self._lifted_s < LIFTED_S:
            self._lifted_s = self._lifted_s + elapsed_s if contact.lifted_m > 0.0 else 0.0
        if self._lifted_s >= LIFTED_S:
            return Reading("no_baseline", self.zeroed.refuted, track.used, track.estimate)
        return Reading(track.health, track.reason, track.used, track.estimate, contact, touching, self.unfelt_n)
