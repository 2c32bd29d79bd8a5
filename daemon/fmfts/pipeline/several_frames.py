"""What C does of a frame of a pad with several magnets: it aligns the samples, and encodes the message (fingers.h)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fmfts.common.record import Record
from fmfts.pad import Array, Pad
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.first_memory import first_memory
from fmfts.pipeline.mounted import mounted_record
from fmfts.pipeline.parameters import chip_fields
from fmfts.pipeline.words import Words, chip_words
from fmfts.pose import Aligned
from fmfts.pose.hand import Hand
from fmfts.pose.magnets import CHANGE
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts.several.estimator import FingersEstimator
from fmfts.several.free_poses import FreePoses
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import FingersReading, PosesReading
from fmfts_client.fields import SCHEMA_VERSION

Estimator = FingersEstimator | PosesEstimator | None
NOT_TOLD = (math.nan, math.nan)


class SeveralTold(NamedTuple):
    """more: no two fingers explain the field. contact: without fingers; −1: not known. displacement: how far the
    magnet moved that moved most, and the deviation of that, in m."""

    more: bool = False
    contact: int = -1
    displacement: tuple[float, float] = NOT_TOLD
    fingers: _pad.Fingers | None = None
    magnets: _pad.Magnets | None = None


class SeveralFrames:
    """parameters: of C's pad, and for `now` (finger.py). memory: of the samples and the last message. hand: see
    SeveralPipeline."""

    def __init__(self, pad: Pad, rate_hz: float, boot: str, model_hash: str, hand: Hand | None = None) -> None:
        self.parameters, self.memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
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
        self.forget()
        self.use(None, None)

    def forget(self) -> None:
        """All samples."""
        self.memory.fill(first_memory(self._pad, None))

    def use(self, estimator: Estimator, baseline_id: str | None) -> None:
        """From the next frame on."""
        words = Words(*self._named, baseline_id, "", "", "", chip_words(self._pad.chip))
        allowed = np.full((len(self._pad.sensors), 3), np.inf) if estimator is None else estimator.repeats_allowed
        self.parameters.put("repeats_allowed", allowed)
        self.compiled = _pad.Pad(self.parameters.buffer, self.memory.buffer, None, None, words, self._unseen, ())
        self._estimator, self.mounted = estimator, mounted_record(estimator).buffer

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
        self, reading: FingersReading | PosesReading, temperature_c: float | None, has_now: bool
    ) -> EncodedMessage:
        """has_now: see Pad.tell."""
        health, reason = reading.health, reading.reason
        if self._posture_unknown and health in ("ok", "degraded", "disturbed", "lost"):
            health = "degraded" if health == "ok" else health
            reason = "; ".join(filter(None, (reason, self._posture_unknown)))
        told = several_told(reading, self._estimator)  # in the order of Pad.tell
        payload = self.compiled.tell(
            health,
            reason,
            math.nan if temperature_c is None else temperature_c,
            has_now,
            self.mounted,
            reading.used,
            *told,
        )
        return EncodedMessage.of(payload, self.compiled)


def several_told(reading: FingersReading | PosesReading, estimator: Estimator) -> SeveralTold:
    if isinstance(estimator, FingersEstimator) and isinstance(reading, FingersReading):
        return _of_fingers(reading, estimator)
    if isinstance(reading, PosesReading) and reading.poses is not None:
        poses, touched = reading.poses, reading.touched
        magnets = _magnets(poses, None if touched else poses.ambient_t)
        return SeveralTold(False, -1 if touched is None else touched, max(_distances(poses)), None, magnets)
    return SeveralTold()


def _of_fingers(reading: FingersReading, estimator: FingersEstimator) -> SeveralTold:
    """The poses alone if no fingers explain the field; no poses beyond the table, where what fingers do is unknown."""
    fit, free, magnets = reading.fit, reading.free, None
    if fit is None:
        return SeveralTold(reading.more) if free is None else SeveralTold(reading.more, 1, magnets=_magnets(free, None))
    if not reading.over_range:
        where, variance = estimator.poses(reading)
        # Under a finger the deviation of the ambient field is larger than that of its mean, but is not kept.
        ambient_t = None if len(fit.fingers) else fit.ambient_t
        magnets = where.position_m, where.axis, variance, fit.misfit_t, fit.chi2, ambient_t
    told = fit.fingers, fit.covariance, fit.shear_n, fit.shear_deviation_n, reading.least_variance
    return SeveralTold(reading.more, fingers=(reading.over_range, reading.ids, *told), magnets=magnets)


def _magnets(poses: FreePoses, ambient_t: _pad.Numbers | None) -> _pad.Magnets:
    where = poses.magnets
    return where.position_m, where.axis, poses.variance, poses.misfit_t, poses.chi2, ambient_t


def _distances(poses: FreePoses) -> list[tuple[float, float]]:
    """How far each magnet is from rest, and the deviation of that."""
    each = [slice(first, first + CHANGE) for first in range(0, len(poses.change), CHANGE)]
    return [_pad.distance(poses.change[own], poses.covariance[own, own].copy()) for own in each]
