"""The whole job of one pad: frame → field → pose → contact → message."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from fmfts.baseline import Baseline, Mounting
from fmfts.bus.messages import ContactMessage, Health
from fmfts.common.memory import require_alike
from fmfts.contact import ContactModel, NoContactModel
from fmfts.pad import Array, Pad, Placement
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.contact_message import MessageWriter, PackedMessage
from fmfts.pipeline.estimator import Estimator, EstimatorMemory
from fmfts.pipeline.fast import FastPath, Lane, Missing, Passed
from fmfts.pipeline.last_frame import LastFrame
from fmfts.pipeline.now import Early, Lead, Taken
from fmfts.pipeline.reading import Reading
from fmfts.pose import Alignment, State, TrackingModel
from fmfts.pose.alignment import AlignmentMemory
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.sighting import Sighting
from fmfts.pose.state import NEIGHBOUR_SIZE
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.sensor.missing import missing_sensors

NO_BASELINE = "no baseline: record one with `fmfts-daemon baseline` while nothing touches the pad"


@dataclass(slots=True)
class PipelineMemory:
    """All that the next message depends on besides its frame, the configuration and the baseline.

    number, sampled_ns: of the last message. sighting: (state, covariance (6, 6), time_ns) of the magnet's last pose.
    """

    alignment: AlignmentMemory
    estimator: EstimatorMemory | None
    number: int
    sampled_ns: int
    sighting: tuple[State, Array, int | None]
    why_no_estimator: str


class PadPipeline:
    """Makes a message of each frame of one pad. model: may serve other pads of the same geometry, too."""

    def __init__(
        self,
        pad: Pad,
        model: ContactModel | NoContactModel,
        boot: str,
        rate_hz: float,
        tracking: TrackingModel,
        lead: Lead = Lead(),  # noqa: B008
    ) -> None:
        self.pad = pad
        self._model = model
        self._rate_hz, self._lead = rate_hz, lead
        self._tracking = tracking
        self._alignment = Alignment(len(pad.sensors), period_us=1e6 / rate_hz)
        self._estimator: Estimator | None = None
        self._at_first: EstimatorMemory | None = None  # the estimator's memory before any frame
        self._why_none = NO_BASELINE
        self._writer = MessageWriter(pad.name, boot, model.hash)
        self._compiled: FastPath | None = None  # not None while C holds the memory
        self._sighting = Sighting.unseen(pad)
        self._neighbours: list[NeighbourView] = []
        self._missing: dict[int, str] = {}
        self._last_frame = LastFrame(rate_hz)

    @property
    def baseline(self) -> Baseline | None:
        return None if self._estimator is None else self._estimator.baseline

    @property
    def messages(self) -> int:
        """The number of the last message."""
        return self._writer.number

    @property
    def model(self) -> ContactModel | NoContactModel:
        return self._model

    @property
    def model_hash(self) -> str:
        return self._model.hash

    @property
    def missing(self) -> dict[int, str]:
        """Sensor (from 0) → why it could not be used in the last frame; empty while frames are absent."""
        return self._missing

    @property
    def detection_limit_n(self) -> float:
        """The largest force (N) anywhere on the pad that may go unfelt; 0 without a baseline."""
        return 0.0 if self._estimator is None else self._estimator.detection_limit_n

    @property
    def baselined(self) -> BaselinedPad | None:
        return None if self._estimator is None else self._estimator.baselined

    @property
    def mounting(self) -> Mounting | None:
        return None if self._estimator is None else self._estimator.mounting

    def use(self, baseline: Baseline, mounting: Mounting | None = None) -> Mounting:
        """From the next frame on, subtract this baseline. BaselineError if it does not fit the pad.

        mounting: computed from the baseline if None. Returns the mounting in use.
        """
        self.hand_back()
        baselined = BaselinedPad.of(self.pad, baseline, self._tracking, mounting)
        self._estimator = Estimator(baselined, self._model, self._rate_hz, self._alignment.stopped_us, self._lead)
        self._at_first = deepcopy(self._estimator.memory)
        self._sighting.rests((self._estimator.mounting.rest,))
        return self._estimator.mounting

    def feel(self, neighbour: Sighting, placement: Placement) -> None:
        """From the next frame on, model the magnets of another pad, too. placement: of that pad, in this one's axes."""
        self.hand_back()
        self._neighbours.append(NeighbourView(neighbour, placement))

    def be_felt(self) -> Sighting:
        """Where this pad's magnet is, for another pad that feels it: kept up to date from the next frame on."""
        return self._sighting

    def start_anew(self) -> None:
        """Forget all frames, because the next have another clock, or an error left half a memory. A new estimator would
        take 15 ms, in which all other pads wait."""
        self._compiled = None
        self._alignment = Alignment(len(self.pad.sensors), period_us=1e6 / self._rate_hz)
        if self._estimator is not None and self._at_first is not None:
            self._estimator.recall(deepcopy(self._at_first))

    def refuse(self, reason: str) -> None:
        """Publish `reason` in every message: there is a baseline, but it cannot be used."""
        self.hand_back()
        self._estimator = None
        self._why_none = reason

    def process(self, frame: Frame) -> ContactMessage:
        """Make the message of one frame."""
        answer = self.answer(frame)
        return answer.message if isinstance(answer, PackedMessage) else answer

    def answer(self, frame: Frame) -> ContactMessage | PackedMessage:
        """Like process(), but returns the encoded message if the fast path handled the frame."""
        if self._compiled is not None and self._estimator is not None:
            judged = None if self._last_frame.leap_us(frame) else self._compiled.judge(frame)
            if judged is not None:
                self._last_frame.become(frame.sequence, frame.device_time_us, frame.host_time_ns)
                estimator = self._estimator
                return self._writer.packed(self._compiled, judged, frame, estimator.mounting, estimator.baseline)
            self.hand_back()
        return self._judge(frame)

    def host_time_ns(self, device_time_us: int) -> int:
        """The host's time of the board's, near the last frame."""
        return self._last_frame.host_time_ns(device_time_us)

    def early(self, early: EarlySample) -> ContactMessage | PackedMessage | None:
        """The message of a sample that came before its frame: what the last frame said, with another `now`. None where
        the sample says nothing new, or cannot be used: the next frame judges it."""
        if self._estimator is None or early.sensor >= len(self.pad.sensors):
            return None
        times = self._last_frame.times
        if self._compiled is not None:
            now_us = self._compiled.early(early)
            return None if now_us is None else self._writer.packed_early(self._compiled, now_us, *times)
        now = self._estimator.early(Early(early.sensor, early.field_t, early.device_time_us))
        return None if now is None else self._writer.early(now, *times)

    def begin(self, clock: bytearray, topic: bytes, pad_index: int, overdue_ns: int) -> Lane | None:
        """Let C handle the next frames, from the board's bytes to the bus. None if Python must judge the next one.

        The arguments are those of FastPath.lane. Until end(), do not use this pipeline.
        """
        if self._compiled is None:
            return None
        lane = self._compiled.lane(clock, topic, pad_index, overdue_ns)
        return lane if self._writer.begin(lane, self._last_frame.sequence, self._last_frame.times) else None

    def end(self, lane: Lane) -> tuple[Passed, PackedMessage] | None:
        """Take the pad back from C. Returns what C handled and the last message; None if there is none."""
        passed = lane.end()
        if passed is None:
            return None
        self._last_frame.become(passed.sequence, passed.frame_us, passed.frame_ns)
        return passed, self._writer.passed(passed)

    def _judge(self, frame: Frame) -> ContactMessage:
        aligned = self._last_frame.aligned(frame, frame.field_t, self._alignment)
        if frame.valid.any() and not aligned.is_old:
            sampled_ns = frame.host_time_ns - (frame.device_time_us - aligned.time_us) * 1000
        else:
            sampled_ns = self._writer.sampled_ns  # the frame holds no new sample, so the newest is still the last one
        stuck = None if self._estimator is None else aligned.repeats > self._estimator.baselined.repeats_allowed
        self._missing = missing_sensors(frame, stuck)
        if self._estimator is None:
            reading = Reading("no_baseline", self._why_none, frame.usable)
        else:
            seen = [view.at(sampled_ns) for view in self._neighbours]
            newest = self._alignment.memory
            taken = Taken(newest.field_t[0], newest.time_us[0], frame.fresh, frame.sequence, frame.device_time_us)
            reading = self._estimator.read(aligned, frame.temperature_c, seen, self._missing, taken)
            if reading.estimate is not None and (reading.contact is not None or reading.distance_m is not None):
                estimate = reading.estimate
                self._sighting.saw((estimate.state,), estimate.covariance[:NEIGHBOUR_SIZE, :NEIGHBOUR_SIZE], sampled_ns)
            if reading.is_steady:
                missing, around = Missing.of(frame), (self._sighting, self._neighbours)
                self._compiled = self._estimator.hand_over(self._alignment, reading, missing, frame.gain_code, *around)
        return self._writer.message(reading, sampled_ns, frame.temperature_c, self.mounting, self.baseline, frame)

    @property
    def memory(self) -> PipelineMemory:
        """What the pipeline remembers between two frames. After this call Python judges the next frame."""
        self.hand_back()
        estimator, sighting = self._estimator, self._sighting
        (last,) = sighting.last
        seen = State(last.position_m, last.axis, last.log_moment, np.zeros(3)), sighting.covariance, sighting.time_ns
        return PipelineMemory(
            self._alignment.memory,
            None if estimator is None else estimator.memory,
            *(self._writer.number, self._writer.sampled_ns),
            seen,
            self._why_none,
        )

    def recall(self, memory: PipelineMemory) -> None:
        """Continue from the memory of another pipeline of the same configuration and baseline.

        ValueError, and nothing changes, if the memory does not fit this pipeline.
        """
        if self._estimator is not None and memory.estimator is not None and memory.estimator.now is None:
            self._estimator.tell_no_now()  # a recording from before there was `now`: say what was said then
        require_alike(memory, self.memory)
        self._alignment.memory = memory.alignment
        if self._estimator is not None and memory.estimator is not None:
            self._estimator.recall(memory.estimator)
        self._writer.number, self._writer.sampled_ns = memory.number, memory.sampled_ns
        last, self._sighting.covariance, self._sighting.time_ns = memory.sighting
        self._sighting.last = (last,)
        self._why_none = memory.why_no_estimator

    def hand_back(self) -> None:
        """Take all memory back from the fast path. Python judges frames until one is healthy."""
        if self._compiled is not None and self._estimator is not None:
            self._estimator.take_back(self._compiled, self._alignment)
        self._compiled = None

    def absent(self, health: Health, reason: str) -> ContactMessage:
        """The message to publish while no frame can be used. It ends the touch: whoever touched may be gone."""
        self.hand_back()
        if self._estimator is not None:
            self._estimator.forget_touch()
        self._missing = {}
        reading = Reading(health, reason, np.zeros((len(self.pad.sensors), 3), dtype=np.bool_))
        return self._writer.message(reading, None, None, self.mounting, self.baseline)
