"""The interface between a session and what presses the pad: a machine or a person."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from fmfts_collect.plan import Press


class Presser(Protocol):
    """Presses the pad. Each call returns when it is done, and keeps the Watch running meanwhile."""

    @property
    def description(self) -> str:
        """Who presses."""

    def begin(self) -> None:
        """Get ready, without touching the pad."""

    def stand_over(self, press: Press) -> None:
        """Go over the place of a press, without touching the pad."""

    def press(self, press: Press) -> None:
        """Press, and hold the force."""

    def refused(self, why: str, times: int, once_more: Callable[[], None]) -> None:
        """Prepare another attempt at a row that was refused `times` times. Raises RefusedError to give up.

        once_more: repeats the call of `stand_over` or `press` that came before the row.
        """

    def lift(self) -> None:
        """Stop touching the pad."""

    def release(self) -> str:
        """Stop touching the pad after an error; returns a sentence about the outcome. Never raises."""

    def close(self) -> None:
        """Close the device."""
