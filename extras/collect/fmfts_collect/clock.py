"""The clock of collecting: the computer's, or a simulated one, which advances only during `sleep`."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that a program can wait on."""

    def now_ns(self) -> int:
        """Time on the clock of frames and forces (of the computer: CLOCK_MONOTONIC)."""

    def sleep(self, seconds: float) -> None:
        """Wait for this long."""


class Monotonic:
    """The computer's clock."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)
