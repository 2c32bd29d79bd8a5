"""The whole job of one pad with several magnets: frame → field → fingers → message.

Without a table of presses it is frame → field → poses → message (several/poses_estimator.py).

It has the interface of `PadPipeline`, so that the daemon, a replay and a recorder do not know which of the two it is.
Python judges its frames, and calls the compiled fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from fmfts.baseline import Baseline
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.bus.messages import ContactMessage, Health
from fmfts.common.memory import require_alike
from fmfts.contact import NoContactModel
from fmfts.contact.array_model import ArrayModel
from fmfts.contact.array_response import ArrayResponse
from fmfts.pad import Array, Pad, Placement
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.finger import FollowedFinger, FollowedMemory
from fmfts.pipeline.judged_in_python import JudgedInPython
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.several_message import SeveralWriter
from fmfts.pipeline.words import BARE_ONLY
from fmfts.pose import Aligned, repeats_allowed
from fmfts.pose.alignment import AlignmentMemory
from fmfts.pose.hand import Hand
from fmfts.pose.neighbour import NeighbourEstimate, NeighbourView
from fmfts.pose.sighting import Sighting, SightingMemory
from fmfts.pose.state import Neighbour
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.sensor.missing import missing_sensors
from fmfts.several.count import Search
from fmfts.several.estimator import FingersEstimator
from fmfts.several.field_model import FieldModel, Scene
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import FingersMemory, FingersReading, PosesMemory, PosesReading
from fmfts.several.sighted import rest_of
from fmfts.several.since_rest import Warmth, present


@dataclass(slots=True)
class SeveralMemory:
    """As PipelineMemory, of a pad with several magnets. sighting: None if no neighbour measures the pad. fingers,
    followed: with a table of presses; poses: without one."""

    alignment: AlignmentMemory
    fingers: FingersMemory | None
    number: int
    sampled_ns: int
    why_no_estimator: str
    sighting: SightingMemory | None = None
    poses: PosesMemory | None = None
    followed: FollowedMemory | None = None


class SeveralPipeline(JudgedInPython):
    """Makes a message of each frame of one pad with several magnets, which C encodes.

    magnet_per_k: temperature coefficient of the remanence.
    """

    memory_kind = SeveralMemory

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
        super().__init__(pad, model.hash, boot, rate_hz, hand)
        self._model, self._lead = model, lead
        self._followed: FollowedFinger | None = None
        self._has_now = False  # the last message, and it is that of a frame
        self._scene, self._magnet_per_k = scene, magnet_per_k
        self._estimator: FingersEstimator | PosesEstimator | None = None
        self._at_first: FingersMemory | PosesMemory | None = None  # the estimator's memory before any frame
        self._sighting = Sighting.unseen(pad)
        self._neighbours: list[NeighbourView] = []
        self._is_felt = False
        self.search: Search = "none"  # the last frame's search for fingers
        self._writer = SeveralWriter(pad, boot, model.hash)

    def _use(self, estimator: FingersEstimator | PosesEstimator | None, baseline: Baseline | None) -> None:
        self._estimator, self._baseline, self._has_now, self._followed = estimator, baseline, False, None
        self._writer.use(estimator, None if baseline is None else baseline.id)

    @property
    def model(self) -> ArrayModel | NoContactModel:
        return self._model

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
        if isinstance(self._model, NoContactModel):
            unknown = ArrayResponse.unknown(len(self.pad.magnets))
            poses = PosesEstimator(FieldModel(self.pad, mounting, unknown, self._scene), *others)
            self._use(poses, baseline)
            self._at_first = deepcopy(poses.memory)
        else:
            fingers = FingersEstimator(FieldModel(self.pad, mounting, self._model.response, self._scene), *others)
            self._use(fingers, baseline)
            if self.hand is None:
                self._followed = FollowedFinger(fingers, self._rate_hz, self._lead, self._writer.parameters)
            if isinstance(before, FingersEstimator):  # a finger of before is another one
                fingers.memory.counter.next_id = before.memory.counter.next_id
            self._at_first = deepcopy(fingers.memory)
        self._sighting.rests(*rest_of(mounting))
        if self.hand is not None:
            self.hand.use(None if baseline.posture is None else baseline.posture.model())
        return mounting

    def feel(self, neighbour: Sighting, placement: Placement) -> None:
        """From the next frame on, take the magnets of another pad into account. placement: of that pad, in this one's
        axes."""
        self._neighbours.append(NeighbourView(neighbour, placement))

    def be_felt(self) -> Sighting:
        """This pad's magnets, for a neighbour that measures them: updated from the next frame on."""
        self._is_felt = True
        return self._sighting

    def start_anew(self) -> None:
        """Forget all frames, because the next have another clock, or an error left half a memory. A new estimator would
        take 15 ms, in which all other pads wait."""
        self._forget_samples()
        self._forget_now()
        memory = deepcopy(self._at_first)
        if isinstance(self._estimator, FingersEstimator) and isinstance(memory, FingersMemory):
            memory.counter.next_id = self._estimator.memory.counter.next_id  # a finger of before is another one
            self._estimator.recall(memory)
        if isinstance(self._estimator, PosesEstimator) and isinstance(memory, PosesMemory):
            self._estimator.recall(memory)

    def refuse(self, reason: str) -> None:
        """Publish `reason` in every message: there is a baseline, but it cannot be used."""
        self._use(None, None)
        self._why_none = reason

    def process(self, frame: Frame) -> ContactMessage:
        """Make the message of one frame."""
        return self.answer(frame).message

    def answer(self, frame: Frame) -> EncodedMessage:
        """The same, encoded."""
        self.search = "none"
        aligned = self._aligned(frame)
        estimator = self._estimator
        reading: FingersReading | PosesReading
        if estimator is None:
            self.missing = missing_sensors(frame, None)
            reading = FingersReading("no_baseline", self._why_none, frame.usable)
        else:
            # Every axis with a measurement has a field: no sensor is missing.
            _, is_whole = present(self._field_t, aligned.repeats, estimator.repeats_allowed)
            self.missing = {} if is_whole else missing_sensors(frame, aligned.repeats > estimator.repeats_allowed)
            seen = [view.at(self._sampled_ns) for view in self._neighbours]
            reading, sighted = self._read(estimator, aligned, frame, seen)
            self.search = reading.search
            if self._is_felt and sighted is not None:
                self._sighting.saw(*sighted, self._sampled_ns)
        self._has_now = (
            self._followed is not None
            and isinstance(reading, FingersReading)
            and not self._neighbours
            and self._followed.after(reading, aligned, frame, self._field_t, self._writer.compiled)
        )
        return self._written(reading, frame.temperature_c)

    def _written(self, reading: FingersReading | PosesReading, temperature_c: float | None) -> EncodedMessage:
        self.messages += 1
        times = self.messages, self._sampled_ns, *self._last_frame.times
        return self._writer.written(reading, self._health(reading), temperature_c, times, self._has_now)

    def early(self, early: EarlySample) -> EncodedMessage | None:
        """The message of a sample that came before its frame: what the last frame said, with another `now`. None where
        it says nothing new."""
        if self._followed is None or not self._has_now or early.sensor >= len(self.pad.sensors):
            return None
        payload = self._followed.early(early, self._writer.compiled)
        return None if payload is None else EncodedMessage.of(payload, self._writer.compiled)

    def _forget_now(self) -> None:
        self._has_now = False
        if self._followed is not None:
            self._followed.forget()

    def _read(
        self,
        estimator: FingersEstimator | PosesEstimator,
        aligned: Aligned,
        frame: Frame,
        neighbours: Sequence[NeighbourEstimate],
    ) -> tuple[FingersReading | PosesReading, tuple[tuple[Neighbour, ...], Array] | None]:
        """The frame's reading, and the magnets for neighbours that measure them."""
        what = aligned, frame.temperature_c, self.missing, neighbours, frame.may_search
        if isinstance(estimator, FingersEstimator):
            fingers = estimator.read(*what)
            return fingers, estimator.sighted(fingers) if self._is_felt else None
        poses = estimator.read(*what)
        if poses.tells and isinstance(self._model, NoContactModel):
            poses = poses._replace(reason="; ".join(filter(None, (poses.reason, self._model.reason))))
        return poses, estimator.sighted(poses) if self._is_felt else None

    @property
    def memory(self) -> SeveralMemory:
        """The pipeline's memory between two frames."""
        estimator = self._estimator
        return SeveralMemory(
            self._alignment.memory,
            estimator.memory if isinstance(estimator, FingersEstimator) else None,
            *(self.messages, self._sampled_ns),
            self._why_none,
            self._sighting.memory if self._is_felt else None,
            estimator.memory if isinstance(estimator, PosesEstimator) else None,
            None if self._followed is None else self._followed.memory,
        )

    def recall(self, memory: SeveralMemory) -> None:
        """Continue from the memory of another pipeline of the same configuration and baseline.

        ValueError, and nothing changes, if the memory does not fit this pipeline.
        """
        require_alike(memory, self.memory)
        self._has_now = False
        if self._followed is not None and memory.followed is not None:
            self._followed.recall(memory.followed)
        self._alignment.memory = memory.alignment
        if isinstance(self._estimator, FingersEstimator) and memory.fingers is not None:
            self._estimator.recall(memory.fingers)
        if isinstance(self._estimator, PosesEstimator) and memory.poses is not None:
            self._estimator.recall(memory.poses)
        self.messages, self._sampled_ns = memory.number, memory.sampled_ns
        self._why_none = memory.why_no_estimator
        if memory.sighting is not None:
            self._sighting.recall(memory.sighting)

    def absent(self, health: Health, reason: str) -> ContactMessage:
        """The message to publish while no frame can be used. It ends the touch: the finger may be gone."""
        if self._estimator is not None:
            self._estimator.forget_touch()
        self._forget_now()
        self.missing = {}
        reading = FingersReading(health, reason, np.zeros((len(self.pad.sensors), 3), dtype=np.bool_))
        return self._written(reading, None).message
