"""Pressed silicone recovers slowly: the rest of a press is no finger, and only roughly known."""

from __future__ import annotations

from dataclasses import dataclass

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
