"""From the reading of a pad with several magnets to its message, which C encodes: fingers.h, message.c."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from fmfts.bus.messages import Health
from fmfts.common.record import Record
from fmfts.pad import Pad
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.mounted import mounted_record
from fmfts.pipeline.parameters import chip_fields
from fmfts.pipeline.words import Words
from fmfts.pose.magnets import CHANGE
from fmfts.pose.sighting import Sighting
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


class SeveralWriter:
    """C's pad. parameters: of it, for `now` (finger.py)."""

    def __init__(self, pad: Pad, boot: str, model_hash: str) -> None:
        self.parameters, self._memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
        self.parameters.fill({"sensors": len(pad.sensors), **chip_fields(pad.chip)})
        self._named = SCHEMA_VERSION, pad.name, boot, model_hash
        self._unseen = Sighting.unseen(replace(pad, other_magnets=())).table.buffer  # no other pad feels it through C
        self.use(None, None)

    def use(self, estimator: Estimator, baseline_id: str | None) -> None:
        """From the next message on."""
        words = Words(*self._named, baseline_id, "", "", "", ((), ""))
        self.compiled = _pad.Pad(self.parameters.buffer, self._memory.buffer, None, None, words, self._unseen, ())
        self._estimator, self._mounted = estimator, mounted_record(estimator).buffer

    def written(
        self,
        reading: FingersReading | PosesReading,
        health: tuple[Health, str],
        temperature_c: float | None,
        times: tuple[int, int, int, int],
        has_now: bool,
    ) -> EncodedMessage:
        """health: with its reason. times, has_now: see Pad.tell."""
        told = several_told(reading, self._estimator)
        payload = self.compiled.tell(
            *health,
            math.nan if temperature_c is None else temperature_c,
            times,
            told.more,
            has_now,
            self._mounted,
            reading.used,
            told.contact,
            told.displacement,
            told.fingers,
            told.magnets,
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
