"""The time that collecting goes by. On a simulated bench it passes only while somebody waits."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What is waited for happens during `sleep`."""

    def now_ns(self) -> int:
        """As CLOCK_MONOTONIC: frames and forces bear its times."""

    def sleep(self, seconds: float) -> None:
        """Let so much time pass."""


class Monotonic:
    """The computer's."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)
