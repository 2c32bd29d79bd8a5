"""What a pad with several magnets remembers, of fingers or of poses; and how pressed silicone recovers, slowly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The rest of a press decays in this time, and in the time for which it was held: silicone recovers as slowly as it
# crept.
RECOVERY_S = 10.0


@dataclass(slots=True)
class Recovery:
    """recent_t (3N,): the field's largest change by fingers, decaying. held_s: how long they pressed, less the time
    since."""

    recent_t: Array
    held_s: float = 0.0

    def pass_time(self, elapsed_s: float, pressed: bool) -> None:
        self.held_s = max(self.held_s + (elapsed_s if pressed else -elapsed_s), 0.0)

    def decay(self, elapsed_s: float) -> float:
        """What divides `recent_t` after this time."""
        return 1.0 + elapsed_s / (RECOVERY_S + self.held_s)


@dataclass(slots=True)
class RestMemory:
    """ambient_t (3,): the change of the ambient field since the baseline. unexplained: number of unexplained frames in
    a row, without those whose search is due. left_out: a sensor that contradicts all others, −1: none. agrees_frames:
    for how many frames it has agreed. last_us: the board's time of the last frame. last_c: the last known temperature.
    unsettled: how many more frames must be explained until they are trusted again."""

    recovery: Recovery
    ambient_t: Array = field(default_factory=lambda: np.zeros(3))
    unexplained: int = 0
    left_out: int = -1
    agrees_frames: int = 0
    last_us: int | None = None
    last_c: float | None = None
    unsettled: int = 0
