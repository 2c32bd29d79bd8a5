"""The whole job of one pad with several magnets: frame → field → fingers → message.

Without a table of presses it is frame → field → poses → message (several/poses_estimator.py).

It has the interface of `PadPipeline`, so that the daemon, a replay and a recorder do not know which of the two it is.
Python judges its frames, and calls the compiled fit.
"""

from __future__ import annotations

from math import nan

import numpy as np

from fmfts.baseline import Baseline
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.bus.messages import ContactMessage, Health
from fmfts.contact import NoContactModel
from fmfts.contact.array_model import ArrayModel
from fmfts.contact.array_response import ArrayResponse
from fmfts.pad import Array, Pad, Placement
from fmfts.pipeline import _pad
from fmfts.pipeline.calm import CalmFrames
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.finger import FollowedFinger
from fmfts.pipeline.first_memory import first_memory
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.remembering import PadMemory, RememberingPipeline
from fmfts.pipeline.several_frames import SeveralFrames
from fmfts.pipeline.words import BARE_ONLY
from fmfts.pose import Aligned, repeats_allowed
from fmfts.pose.hand import Hand
from fmfts.pose.neighbour import NeighbourEstimate, NeighbourView
from fmfts.pose.sighting import Sighting
from fmfts.pose.state import Neighbour
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.several.count import Search
from fmfts.several.estimator import FingersEstimator
from fmfts.several.field_model import FieldModel, Scene
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import FingersReading, PosesReading, Seen
from fmfts.several.sighted import rest_of
from fmfts.several.since_rest import Warmth


class SeveralPipeline(RememberingPipeline):
    """Makes a message of each frame of one pad with several magnets.

    magnet_per_k: temperature coefficient of the remanence. missing: sensor (from 0) → why it could not be used in the
    last frame; empty while frames are absent. hand: that the pad is on, if its field depends on the hand's posture.
    """

    further_drift = ""  # only PadPipeline finds it
    force_scale: float | None = None  # no weight measures the silicone of such a pad

    def __init__(
        self,
        pad: Pad,
        model: ArrayModel | NoContactModel,
        boot: str,
        rate_hz: float,
        scene: Scene,
        magnet_per_k: float,
        *,
        hand: Hand | None = None,
        lead: Lead = Lead(),  # noqa: B008
    ) -> None:
        super().__init__(pad)
        self.hand, self.model, self.model_hash = hand, model, model.hash
        self._rate_hz, self._lead = rate_hz, lead
        self._baseline: Baseline | None = None
        self.missing: dict[int, str] = {}
        self._followed: FollowedFinger | None = None
        self._calm: CalmFrames | None = None
        self._has_now = False  # the last message, and it is that of a frame
        self._scene, self._magnet_per_k = scene, magnet_per_k
        self._estimator: FingersEstimator | PosesEstimator | None = None
        self._is_felt = False
        self.search: Search = "none"  # the last frame's search for fingers
        self._frames = SeveralFrames(pad, self._memory, rate_hz, boot, model.hash, hand)

    def _use(self, estimator: FingersEstimator | PosesEstimator | None, baseline: Baseline | None) -> None:
        self._estimator, self._baseline, self._has_now = estimator, baseline, False
        self._followed = self._calm = None
        self._frames.use(estimator, None if baseline is None else baseline.id)

    @property
    def baseline(self) -> Baseline | None:
        return self._baseline

    def begin(self, clock: memoryview, topic: bytes, pad_index: int, overdue_ns: int) -> None:
        """C never takes such a pad's frames from a board's bytes."""

    def end(self, pad: _pad.Pad) -> None:
        """There is nothing to take back, because `begin` lent nothing."""

    @property
    def detection_limit_n(self) -> float:
        return 0.0

    @property
    def force_scale_sd(self) -> float | None:
        """Deviation of the scale of all forces through the silicone, as a share; None: not known."""
        return self._scene.silicone

    @property
    def mounting(self) -> ArrayMounting | None:
        return None if self._estimator is None else self._estimator.mounting

    def use(self, baseline: Baseline, mounting: ArrayMounting | None = None) -> ArrayMounting | None:
        """From the next frame on, subtract this baseline. BaselineError if it does not fit the pad.

        Returns the mounting; None, and nothing is published yet, if there is only a bare recording.
        """
        if baseline.rest is None:
            self._why_none = BARE_ONLY
            self._use(None, baseline)
            return None
        rest, mounting = baseline.rest, mounting or baseline.array_mounting(self.pad)
        before = self._estimator
        allowed = repeats_allowed(mounting.noise_t, self.pad.chip.coarseness_t(rest.gain_code))
        others = self._rate_hz, allowed, Warmth(self._magnet_per_k, rest.temperature_c)
        if isinstance(self.model, NoContactModel):
            unknown = ArrayResponse.unknown(len(self.pad.magnets))
            poses = PosesEstimator(FieldModel(self.pad, mounting, unknown, self._scene), *others)
            self._use(poses, baseline)
        else:
            fingers = FingersEstimator(FieldModel(self.pad, mounting, self.model.response, self._scene), *others)
            self._use(fingers, baseline)
            if self.hand is None and not self._neighbours:
                self._followed = FollowedFinger(fingers, self._lead, self._frames.parameters, self._frames.compiled)
                self._calm = CalmFrames(fingers, self._frames, self._followed.buffer)
            if isinstance(before, FingersEstimator):  # earlier fingers keep their ids
                fingers.memory.counter.next_id = before.memory.counter.next_id
        self._sighting.rests(*rest_of(mounting))
        if self.hand is not None:
            self.hand.use(None if baseline.posture is None else baseline.posture.model())
        return mounting

    def feel(self, neighbour: Sighting, placement: Placement) -> None:
        """From the next frame on, take the magnets of another pad into account. placement: of that pad, in this one's
        axes."""
        self._neighbours.append(NeighbourView(neighbour, placement))
        self._followed = self._calm = None
        self._frames.bind()

    def be_felt(self) -> Sighting:
        """This pad's magnets, for a neighbour that measures them: updated from the next frame on."""
        self._is_felt = True
        return self._sighting

    def start_anew(self) -> None:
        """Forget all frames, because the next have another clock, or an error left half a memory. A new estimator would
        take some milliseconds, in which all other pads wait."""
        self._memory.fill(first_memory(self.pad, None))
        self._has_now = False
        if self._followed is not None:
            self._followed.forget()
        if self._estimator is not None:
            self._estimator.start_anew()

    def refuse(self, reason: str) -> None:
        """Publish `reason` in every message: there is a baseline, but it cannot be used."""
        self._use(None, None)
        self._why_none = reason

    def answer(self, frame: Frame) -> EncodedMessage:
        self.search = "none"
        aligned, newest_t, is_whole = self._frames.aligned(frame)
        self.missing = {} if is_whole else self._frames.compiled.missing()
        estimator = self._estimator
        reading: FingersReading | PosesReading
        if estimator is None:
            reading = FingersReading("no_baseline", self._why_none, frame.usable)
        elif isinstance(estimator, FingersEstimator):
            estimator.begin(aligned, frame.temperature_c)
            told = self._calmly(estimator, aligned, frame, newest_t)
            if isinstance(told, bytes):
                return EncodedMessage.of(told, self._frames.compiled)
            reading = estimator.look(told, self.missing, frame.may_search)
            self._show(estimator.sighted(reading) if self._is_felt else None)
        else:
            reading = estimator.read(aligned, frame.temperature_c, self.missing, self._seen, frame.may_search)
            if reading.tells and isinstance(self.model, NoContactModel):
                reading = reading._replace(reason="; ".join(filter(None, (reading.reason, self.model.reason))))
            self._show(estimator.sighted(reading) if self._is_felt else None)
        self.search = reading.search
        ahead = None if self._followed is None else self._followed.ahead(reading, aligned, frame, newest_t)
        message, self._has_now = self._frames.message(reading, frame.temperature_c, ahead)
        return message

    @property
    def _seen(self) -> list[NeighbourEstimate]:
        """The magnets of other pads at the time of the last sample."""
        return [view.at(self._frames.sampled_ns) for view in self._neighbours]

    def _calmly(self, estimator: FingersEstimator, aligned: Aligned, frame: Frame, newest_t: Array) -> bytes | Seen:
        """The message of a calm frame; or what is known of another one."""
        calm, followed = self._calm, self._followed
        if calm is None or followed is None or not estimator.memory.is_calm:
            return estimator.seen(aligned, self._seen)
        told = calm.payload(nan if frame.temperature_c is None else frame.temperature_c)
        if isinstance(told, bytes):
            self._has_now = calm.has_now
            if not estimator.memory.counter.count:
                followed.rests(calm.measured, aligned, frame, newest_t)
            self._show(estimator.sighted(calm.reading) if self._is_felt else None)
        return told

    def _show(self, sighted: tuple[tuple[Neighbour, ...], Array] | None) -> None:
        """For pads that measure this one's magnets."""
        if sighted is not None:
            self._sighting.saw(*sighted, self._frames.sampled_ns)

    def early(self, early: EarlySample) -> EncodedMessage | None:
        """The message of a sample that came before its frame: what the last frame said, with another `now`. None where
        it says nothing new."""
        if self._followed is None or not self._has_now or early.sensor >= len(self.pad.sensors):
            return None
        payload = self._followed.early(early)
        return None if payload is None else EncodedMessage.of(payload, self._frames.compiled)

    @property
    def memory(self) -> PadMemory:
        memory, estimator = super().memory, self._estimator
        memory.fingers = estimator.memory if isinstance(estimator, FingersEstimator) else None
        memory.poses = estimator.memory if isinstance(estimator, PosesEstimator) else None
        memory.followed = None if self._followed is None else self._followed.memory
        return memory

    def _go_on(self, memory: PadMemory) -> None:
        self._has_now, self._why_none = False, memory.why_no_baseline
        if self._followed is not None and memory.followed is not None:
            self._followed.recall(memory.followed)
        if isinstance(self._estimator, FingersEstimator) and memory.fingers is not None:
            self._estimator.recall(memory.fingers)
        if isinstance(self._estimator, PosesEstimator) and memory.poses is not None:
            self._estimator.recall(memory.poses)

    def absent(self, health: Health, reason: str) -> ContactMessage:
        """The message to publish while no frame can be used. It ends the touch: the finger may be gone."""
        if self._estimator is not None:
            self._estimator.forget_touch()
        self.missing = {}
        reading = FingersReading(health, reason, np.zeros((len(self.pad.sensors), 3), dtype=np.bool_))
        message, self._has_now = self._frames.message(reading, None)
        return message.message
