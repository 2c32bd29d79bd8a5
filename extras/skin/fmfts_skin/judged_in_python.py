"""The common part of pads whose frames Python judges: one clock, one instant, numbered messages.

C judges the frames of a pad with one magnet (frame.c). For these pads C does not read frames from a board's bytes.
"""

from __future__ import annotations

import time
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage, Health
from fmfts.pad import Pad
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.words import NO_BASELINE
from fmfts.pose import Aligned, Alignment
from fmfts.pose.hand import Hand
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts_skin.last_frame import LastFrame
from fmfts_skin.sensors_ok import mask_of


class Judged(Protocol):
    """The result of one frame. used (N, 3): the axes that it was made from."""

    @property
    def health(self) -> Health: ...
    @property
    def reason(self) -> str: ...
    @property
    def used(self) -> NDArray[np.bool_]: ...


class JudgedInPython:
    """messages: the number of the last one. missing: sensor (from 0) → why it could not be used in the last frame;
    empty while frames are absent. hand: that the pad is on, if its field depends on the hand's posture."""

    further_drift = ""  # only PadPipeline finds it

    def __init__(self, pad: Pad, model_hash: str, boot: str, rate_hz: float, hand: Hand | None = None) -> None:
        self.pad, self._model_hash, self._boot, self._rate_hz = pad, model_hash, boot, rate_hz
        self.hand = hand
        self._posture_unknown = ""  # why, in the last frame
        self.messages, self._sampled_ns = 0, 0
        self.missing: dict[int, str] = {}
        self._why_none = NO_BASELINE
        self._baseline: Baseline | None = None
        self._last_frame = LastFrame(rate_hz)
        self._forget_samples()

    @property
    def baseline(self) -> Baseline | None:
        return self._baseline

    @property
    def model_hash(self) -> str:
        return self._model_hash

    def process(self, frame: Frame) -> ContactMessage:
        """Make the message of one frame."""
        raise NotImplementedError

    def answer(self, frame: Frame) -> ContactMessage | EncodedMessage:
        return self.process(frame)

    def host_time_ns(self, device_time_us: int) -> int:
        """The host's time of the board's, near the last frame."""
        return self._last_frame.host_time_ns(device_time_us)

    def early(self, early: EarlySample) -> ContactMessage | EncodedMessage | None:
        """Ignores a sample that comes before its frame, unless the pad has a `now`."""
        return None

    def begin(self, clock: memoryview, topic: bytes, pad_index: int, overdue_ns: int) -> None:
        """C never takes such a pad's frames from a board's bytes."""

    def end(self, pad: _pad.Pad) -> None:
        """There is nothing to take back, because `begin` lent nothing."""

    @property
    def force_scale(self) -> float | None:
        """How stiff the silicone is against the contact model's: no weight measures it on such a pad."""
        return None

    def _forget_samples(self) -> None:
        self._alignment = Alignment(len(self.pad.sensors), period_us=1e6 / self._rate_hz)

    def _aligned(self, frame: Frame) -> Aligned:
        """The frame's samples at one instant. Notes when that was, on the host's clock."""
        self._field_t = frame.field_t  # of which each frame makes another array
        aligned = self._last_frame.aligned(frame, self._field_t, self._alignment)
        if frame.valid.any() and not aligned.is_old:
            # Else the frame holds no new sample, so the newest is still the last one.
            self._sampled_ns = frame.host_time_ns - (frame.device_time_us - aligned.time_us) * 1000
        return aligned if self.hand is None else self._without_posture(aligned, frame, self.hand)

    def _without_posture(self, aligned: Aligned, frame: Frame, hand: Hand) -> Aligned:
        if frame.joints is not None:
            hand.recall(frame.joints)
        field_t, foreign_t2, self._posture_unknown = hand.at(self._sampled_ns)
        return aligned._replace(field_t=aligned.field_t - field_t.reshape(-1, 3), foreign_t2=foreign_t2)

    def _health(self, reading: Judged) -> tuple[Health, str]:
        """Of a frame's reading, and of the posture's field, which may not be known."""
        health, reason = reading.health, reading.reason
        if self._posture_unknown and health in ("ok", "degraded", "disturbed", "lost"):
            health = "degraded" if health == "ok" else health
            reason = "; ".join(filter(None, (reason, self._posture_unknown)))
        return health, reason

    def _message(self, reading: Judged, told: dict[str, Any], temperature_c: float | None) -> ContactMessage:
        """told: the message's estimates, by field."""
        self.messages += 1
        health, reason = self._health(reading)
        return ContactMessage(
            pad=self.pad.name,
            boot=self._boot,
            seq=self.messages,
            t_sample_ns=self._sampled_ns,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            temperature_c=temperature_c,
            health=health,
            reason=reason,
            **told,
            sensors_ok=mask_of(reading.used),
            model=self._model_hash,
            baseline=None if self._baseline is None else self._baseline.id,
        )
