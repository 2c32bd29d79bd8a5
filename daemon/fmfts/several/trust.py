"""Fingers that explain a frame, and are not to be trusted all the same: told, and said to be `degraded`."""

from __future__ import annotations

from fmfts.several import reasons
from fmfts.several.reading import FingersMemory, FingersReading

# After a frame that nothing explains, so many in a row have to be explained. Where a magnet is broken, or three fingers
# press, one frame of two or three is explained by chance, each time by other fingers.
SETTLED_FRAMES = 10


def trusted(reading: FingersReading, memory: FingersMemory, has_jumped: bool) -> FingersReading:
    """The reading of a frame as it may be told. has_jumped: some of its samples are from before the field jumped, some
    from after it, and fingers that are not there may explain both."""
    if reading.health == "disturbed":
        if reading.search != "due":  # one that waits may be explained as soon as it is searched
            memory.unsettled = SETTLED_FRAMES
        return reading
    doubt = reasons.JUMPED if has_jumped else reasons.UNSETTLED if memory.unsettled else ""
    memory.unsettled = max(memory.unsettled - 1, 0)
    if doubt and reading.has_fingers:
        return reading._replace(health="degraded", reason=reading.reason or doubt)
    return reading
