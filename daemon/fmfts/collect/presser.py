"""What every way to press looks like to the session."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from fmfts.collect.plan import Press


class Presser(Protocol):
    """Each call returns when it is done, and listens to the Watch meanwhile."""

    @property
    def description(self) -> str:
        """Who presses."""

    def begin(self) -> None:
        """Be ready, with the pad untouched."""

    def stand_over(self, press: Press) -> None:
        """Be over the place of a press, the pad untouched."""

    def press(self, press: Press) -> None:
        """Press, and hold the force."""

    def refused(self, why: str, times: int, once_more: Callable[[], None]) -> None:
        """A row was refused so many times; returns when the next may be tried. RefusedError: that is enough.

        once_more: the call of `stand_over` or `press` that led to it.
        """

    def lift(self) -> None:
        """Touch the pad no more."""

    def release(self) -> str:
        """The same after something went wrong; a sentence on how that ended. Raises nothing."""

    def close(self) -> None:
        """Give the device back."""
