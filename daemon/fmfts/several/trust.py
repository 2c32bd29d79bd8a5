"""Fingers or poses that explain a frame but cannot be trusted: published as `degraded`."""

from __future__ import annotations

from typing import TypeVar

from fmfts.several import reasons
from fmfts.several.reading import FingersReading, PosesReading
from fmfts.several.recovery import RestMemory

AnyReading = TypeVar("AnyReading", FingersReading, PosesReading)

# After an unexplained frame, this many in a row must be explained. If a magnet is broken, or three fingers press, one
# frame in two or three is explained by chance, each time by other fingers.
SETTLED_FRAMES = 10


def trusted(reading: AnyReading, memory: RestMemory, has_jumped: bool) -> AnyReading:
    """The reading of a frame as it may be published. has_jumped: some samples are from before a jump of the field, some
    from after it, and false fingers may explain both."""
    if reading.is_unexplained:
        memory.unsettled = SETTLED_FRAMES
    if reading.is_unexplained or reading.health == "disturbed":  # a waiting frame may be explained when it is searched
        return reading
    unsettled = reasons.UNSETTLED if isinstance(reading, FingersReading) else reasons.UNSETTLED_POSES
    doubt = reasons.JUMPED if has_jumped else unsettled if memory.unsettled else ""
    memory.unsettled = max(memory.unsettled - 1, 0)
    if doubt and reading.tells:
        return reading._replace(health="degraded", reason=reading.reason or doubt)
    return reading
