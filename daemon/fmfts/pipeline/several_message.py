"""The messages of a pad with several magnets."""

from __future__ import annotations

import time
from typing import Any

from fmfts.baseline import Baseline
from fmfts.bus.messages import NO_ESTIMATE_OF_SEVERAL, ContactMessage
from fmfts.pipeline.fingers_message import fingers_told
from fmfts.pipeline.poses_message import poses_told
from fmfts.pipeline.sensors_ok import mask_of
from fmfts.several.estimator import FingersEstimator
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import FingersReading, PosesReading


class SeveralWriter:
    """Makes the messages of one pad with several magnets, and numbers them."""

    def __init__(self, pad: str, boot: str, model: str) -> None:
        self._pad, self._boot, self._model = pad, boot, model
        self.number = 0
        self.sampled_ns = 0

    def message(
        self,
        reading: FingersReading | PosesReading,
        sampled_ns: int | None,
        temperature_c: float | None,
        estimator: FingersEstimator | PosesEstimator | None,
        baseline: Baseline | None,
    ) -> ContactMessage:
        """The message of a reading. sampled_ns: host time of the sample; None, without a frame, repeats the last."""
        self.sampled_ns = self.sampled_ns if sampled_ns is None else sampled_ns
        self.number += 1
        more = isinstance(reading, FingersReading) and reading.more
        estimates: dict[str, Any] = NO_ESTIMATE_OF_SEVERAL | {"over_range": False, "more": more}
        estimates |= _told(reading, estimator)
        return ContactMessage(
            pad=self._pad,
            boot=self._boot,
            seq=self.number,
            t_sample_ns=self.sampled_ns,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            temperature_c=temperature_c,
            health=reading.health,
            reason=reading.reason,
            **estimates,
            sensors_ok=mask_of(reading.used),
            model=self._model,
            baseline=None if baseline is None else baseline.id,
        )


def _told(
    reading: FingersReading | PosesReading, estimator: FingersEstimator | PosesEstimator | None
) -> dict[str, Any]:
    if isinstance(estimator, FingersEstimator) and isinstance(reading, FingersReading):
        return fingers_told(reading, estimator)
    if isinstance(estimator, PosesEstimator) and isinstance(reading, PosesReading):
        return poses_told(reading, estimator)
    return {}
