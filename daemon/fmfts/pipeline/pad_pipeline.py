"""One pad with one magnet: makes its parameters, and lets C judge each frame (frame.c names the steps)."""

from __future__ import annotations

import numpy as np

from fmfts.baseline import Baseline, Mounting
from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import ContactMessage, Health
from fmfts.contact import ContactModel, NoContactModel
from fmfts.pad import Pad, Placement
from fmfts.pipeline import _pad
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.encoded import EncodedMessage, Passed
from fmfts.pipeline.first_memory import first_memory, without_samples
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.parameters import packed_errors, packed_response, parameters_of, put_neighbours
from fmfts.pipeline.remembering import PadMemory, RememberingPipeline
from fmfts.pipeline.weighed import on_weighed_silicone
from fmfts.pipeline.words import further_drift_of, words_of
from fmfts.pose import TrackingModel
from fmfts.pose.hand import Hand
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample


class PadPipeline(RememberingPipeline):
    """Makes a message of each frame of one pad. model: may serve other pads of the same geometry, too. hand: that the
    pad is on, if its field depends on the hand's posture.
    """

    def __init__(
        self,
        pad: Pad,
        model: ContactModel | NoContactModel,
        boot: str,
        rate_hz: float,
        tracking: TrackingModel,
        *,
        lead: Lead = Lead(),  # noqa: B008
        hand: Hand | None = None,
    ) -> None:
        super().__init__(pad)
        self.model = self._unweighed = model
        self._boot, self._rate_hz, self._tracking, self._lead = boot, rate_hz, tracking, lead
        self.hand = hand
        self._baselined: BaselinedPad | None = None
        self._has_frame = False  # the last message is that of a frame
        self._build()

    def _build(self) -> None:
        """Make C's pad anew, with the same memory."""
        self._parameters = parameters_of(self.pad, self._baselined, self.model, self._rate_hz, self._lead)
        put_neighbours(self._parameters, self._neighbours)
        seen = tuple((each.sighting.table.buffer, len(each.sighting.magnets)) for each in self._neighbours)
        self._compiled = _pad.Pad(
            self._parameters.buffer,
            self._memory.buffer,
            self.model.inference.for_c if isinstance(self.model, ContactModel) else None,
            packed_response(self.model),
            words_of(self.pad, self._boot, self.model, self._baselined, self._why_none),
            self._sighting.table.buffer,
            seen,
            None if self.hand is None else self.hand.table.buffer,
            packed_errors(self._baselined),
        )

    @property
    def baseline(self) -> Baseline | None:
        return None if self._baselined is None else self._baselined.baseline

    @property
    def baselined(self) -> BaselinedPad | None:
        return self._baselined

    @property
    def force_scale(self) -> float | None:
        """Stiffness of the silicone by a known weight, over that of the contact model's pad; None: not weighed."""
        stored = None if self.baseline is None or self.model is self._unweighed else self.baseline.silicone
        return None if stored is None else stored.stiffness

    @property
    def force_scale_sd(self) -> float | None:
        """Deviation of the scale of all forces through the silicone, as a share; None: not known."""
        return self.model.tolerance.force_share if isinstance(self.model, ContactModel) else None

    @property
    def mounting(self) -> Mounting | None:
        return None if self._baselined is None else self._baselined.mounting

    @property
    def model_hash(self) -> str:
        return self.model.hash

    @property
    def missing(self) -> dict[int, str]:
        """Sensor (from 0) → why it could not be used in the last frame; empty while frames are absent."""
        return self._compiled.missing() if self._has_frame else {}

    @property
    def further_drift(self) -> str:
        """A sentence for the status if offsets drift further than the chip's figure says; else empty."""
        further, warmed_k = (self._memory.number(name) for name in ("further_drift", "warmed_k"))
        return further_drift_of(self._parameters.number("offset_t_per_k"), further, warmed_k)

    @property
    def detection_limit_n(self) -> float:
        """The largest force (N) anywhere on the pad that may go undetected; 0 without a baseline."""
        return self._parameters.number("detection_limit_n")

    def use(self, baseline: Baseline, mounting: Mounting | None = None) -> Mounting:
        """From the next frame on, subtract this baseline. BaselineError if it does not fit the pad.

        mounting: computed from the baseline if None. Returns the mounting in use.
        """
        self._baselined = BaselinedPad.of(self.pad, baseline, self._tracking, mounting, self.hand is not None)
        self.model = on_weighed_silicone(self._unweighed, baseline)
        if self.hand is not None:
            model = None if baseline.posture is None else baseline.posture.model()
            self.hand.use(model, self._baselined.to_pose())
        self._memory.fill(without_samples(first_memory(self.pad, self._baselined)))
        self._sighting.rests((self._baselined.mounting.rest,))
        self._build()
        return self._baselined.mounting

    def refuse(self, reason: str) -> None:
        """Publish `reason` in every message: there is a baseline, but it cannot be used."""
        self._baselined, self._why_none, self.model = None, reason, self._unweighed
        self._build()

    def feel(self, neighbour: Sighting, placement: Placement) -> None:
        """From the next frame on, model the magnets of another pad, too. placement: of that pad, in this one's axes."""
        self._neighbours.append(NeighbourView(neighbour, placement))
        self._build()

    def be_felt(self) -> Sighting:
        """This pad's magnet, for a neighbour that measures it: updated from the next frame on."""
        return self._sighting

    def start_anew(self) -> None:
        """Forget all frames, because the next have another clock, or one caused an error."""
        self._memory.fill(first_memory(self.pad, self._baselined))

    def answer(self, frame: Frame) -> EncodedMessage:
        return EncodedMessage.of(self.payload(frame), self._compiled)

    def payload(self, frame: Frame) -> bytes:
        """The message of one frame, encoded for sending only."""
        if frame.joints is not None and self.hand is not None:
            self.hand.recall(frame.joints)
        temperature_c = np.nan if frame.temperature_c is None else frame.temperature_c
        times = frame.device_time_us, frame.host_time_ns
        payload = self._compiled.judge(*frame.packed, frame.sequence, *times, temperature_c)
        self._has_frame = True
        return payload

    def early(self, early: EarlySample) -> EncodedMessage | None:
        """The message of a sample that came before its frame: the last message with another `now`. None if the sample
        is not new, or cannot be used: the next frame judges it."""
        if not self._has_frame or early.sensor >= len(self.pad.sensors):
            return None
        payload = self._compiled.early(early.sensor, early.gain_code, *early.counts, early.device_time_us)
        return None if payload is None else EncodedMessage.of(payload, self._compiled)

    def absent(self, health: Health, reason: str) -> ContactMessage:
        """The message to publish while no frame can be used. It ends the touch: the finger may be gone."""
        self._has_frame = False
        return decode_contact(self._compiled.absent(health, reason))

    def begin(self, clock: memoryview, topic: bytes, pad_index: int, overdue_ns: int) -> _pad.Pad | None:
        """Let a Loop judge the next frames, from the board's bytes to the bus. The arguments are those of Pad.begin.

        Until end(), do not use this pipeline.
        """
        self._compiled.begin(clock, topic, pad_index, overdue_ns)
        return self._compiled

    def end(self, pad: _pad.Pad) -> tuple[Passed, EncodedMessage] | None:
        """Take the pad back. Returns what the Loop handled and the last message; None if there is none."""
        ended = pad.end()
        if ended is None:
            return None
        passed = Passed(*ended)
        self._has_frame = True
        return passed, EncodedMessage.of(passed.payload, pad)

    def _go_on(self, memory: PadMemory) -> None:
        self._has_frame = False
        if memory.why_no_baseline != self._why_none:
            self._why_none = memory.why_no_baseline
            self._build()
