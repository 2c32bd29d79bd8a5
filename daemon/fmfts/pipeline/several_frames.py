"""What C does of a frame of a pad with several magnets: it aligns the samples, and encodes the message (fingers.h)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fmfts.common.record import Record
from fmfts.pad import Array, Pad
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.found import Estimator, put_reading
from fmfts.pipeline.mounted import mounted_record
from fmfts.pipeline.parameters import chip_fields
from fmfts.pipeline.words import Words, chip_words
from fmfts.pose import Aligned
from fmfts.pose.hand import Hand
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts.several.reading import FingersReading, PosesReading
from fmfts_client.fields import SCHEMA_VERSION


class SeveralFrames:
    """parameters: of C's pad, and for `now` (finger.py). memory: of MEMORY, of which it uses the samples and the last
    message. hand: see SeveralPipeline."""

    def __init__(
        self, pad: Pad, memory: Record, rate_hz: float, boot: str, model_hash: str, hand: Hand | None = None
    ) -> None:
        self.parameters, self.memory = Record(_pad.PARAMETERS), memory
        self.parameters.fill({"sensors": len(pad.sensors), "period_us": 1e6 / rate_hz, **chip_fields(pad.chip)})
        self._hand, self._posture_unknown = hand, ""  # why, in the last frame
        each = len(pad.sensors), 3
        self._room = (
            np.empty(each),
            np.empty((each[0], 1)),
            np.empty(each),
            np.empty(each, dtype=np.int64),
            np.empty(each),
        )
        self._pad, self._named = pad, (SCHEMA_VERSION, pad.name, boot, model_hash)
        self._unseen = Sighting.unseen(replace(pad, other_magnets=())).table.buffer  # no other pad feels it through C
        self.use(None, None)

    def use(self, estimator: Estimator, baseline_id: str | None) -> None:
        """From the next frame on."""
        words = Words(*self._named, baseline_id, "", "", "", chip_words(self._pad.chip))
        allowed = np.full((len(self._pad.sensors), 3), np.inf) if estimator is None else estimator.repeats_allowed
        self.parameters.put("repeats_allowed", allowed)
        self.compiled = _pad.Pad(self.parameters.buffer, self.memory.buffer, None, None, words, self._unseen, ())
        self._estimator, self._mounted, self.found = estimator, mounted_record(estimator), Record(_pad.FOUND)
        self.bind()

    def bind(self, *calm: memoryview | Array) -> None:
        """calm: what C judges calm frames with, as Pad.bind has it; nothing: it judges none."""
        self.bound = self._mounted.buffer, self.found.buffer, calm
        self.compiled.bind(*self.bound)

    def aligned(self, frame: Frame) -> tuple[Aligned, Array, bool]:
        """The samples at one instant, without the posture's field; the newest (N, 3), NaN where there are none; and
        whether every axis has a field. The next frame's are in the same arrays."""
        temperature_c = math.nan if frame.temperature_c is None else frame.temperature_c
        times = frame.sequence, frame.device_time_us, frame.host_time_ns
        field_t, share, bend_t, repeats, newest_t = self._room
        time_us, is_old, began_anew, leap_us, is_whole = self.compiled.align(
            *frame.packed, *times, temperature_c, *self._room
        )
        aligned = Aligned(field_t, share, bend_t, time_us, repeats, is_old, began_anew, leap_us)
        return self._without_posture(aligned, frame), newest_t, is_whole

    def _without_posture(self, aligned: Aligned, frame: Frame) -> Aligned:
        if self._hand is None:
            return aligned
        if frame.joints is not None:
            self._hand.recall(frame.joints)
        field_t, foreign_t2, self._posture_unknown = self._hand.at(self.sampled_ns)
        return aligned._replace(field_t=aligned.field_t - field_t.reshape(-1, 3), foreign_t2=foreign_t2)

    @property
    def sampled_ns(self) -> int:
        """The host's time of the last sample."""
        return self.memory.integer("sampled_ns")

    def message(
        self, reading: FingersReading | PosesReading, temperature_c: float | None, ahead: memoryview | None = None
    ) -> tuple[EncodedMessage, bool]:
        """And whether it has a `now`. ahead: see Pad.tell."""
        health, reason = reading.health, reading.reason
        if self._posture_unknown and health in ("ok", "degraded", "disturbed", "lost"):
            health = "degraded" if health == "ok" else health
            reason = "; ".join(filter(None, (reason, self._posture_unknown)))
        put_reading(self.found, reading, self._estimator)
        temperature_c = math.nan if temperature_c is None else temperature_c
        payload, has_now = self.compiled.tell(health, reason, temperature_c, ahead)
        return EncodedMessage.of(payload, self.compiled), has_now
