"""From the reading of a pad with several magnets to the estimates of its message."""

from __future__ import annotations

from typing import Any

from fmfts.bus.messages import NO_ESTIMATE_OF_SEVERAL
from fmfts.pipeline.fingers_message import fingers_told
from fmfts.pipeline.poses_message import poses_told
from fmfts.several.estimator import FingersEstimator
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import FingersReading, PosesReading


def several_told(
    reading: FingersReading | PosesReading, estimator: FingersEstimator | PosesEstimator | None
) -> dict[str, Any]:
    more = isinstance(reading, FingersReading) and reading.more
    told: dict[str, Any] = NO_ESTIMATE_OF_SEVERAL | {"over_range": False, "more": more}
    if isinstance(estimator, FingersEstimator) and isinstance(reading, FingersReading):
        return told | fingers_told(reading, estimator)
    if isinstance(estimator, PosesEstimator) and isinstance(reading, PosesReading):
        return told | poses_told(reading, estimator)
    return told
