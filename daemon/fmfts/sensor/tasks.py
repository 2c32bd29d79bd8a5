"""Work on one pad that takes seconds: the running daemon does it between frames, a verb without a daemon by itself."""

from __future__ import annotations

import time
from typing import Any, Protocol

from fmfts.sensor import Source

# A board says hello within a second of being opened, a reader process starts in half of one; on a slow or busy computer
# it takes seconds, which do not count.
PATIENCE_S = 3.0
OPENING_S = 15.0
USUAL_SELFTEST_S = 5.0
SELFTEST_S = 25.0  # longer than a source waits for its device (wire/selftests.py)


class Deadline:
    """PATIENCE_S after the last sign of life of these sources, or after the last of them was opened."""

    def __init__(self, *sources: Source) -> None:
        self._sources = sources
        self._begun_s = self._heard_s = time.monotonic()

    def heard(self) -> None:
        """There was a sign of life."""
        self._heard_s = time.monotonic()

    def passed(self, now_s: float) -> bool:
        """now_s: time.monotonic()."""
        if now_s - self._begun_s < OPENING_S and any(source.state.is_opening for source in self._sources):
            self._heard_s = now_s
        return now_s - self._heard_s > PATIENCE_S


class Task(Protocol):
    """Call `facts`, then `problem`, a few times a second until one of them has a result."""

    @property
    def share(self) -> float:
        """The share that is done, 0 to 1."""

    @property
    def hint(self) -> str:
        """What a person should do now, "" if nothing."""

    def facts(self) -> dict[str, Any] | None:
        """The result, None while there is none. Raises the error that ended the work."""

    def problem(self, now_s: float) -> str:
        """Why there will be no result; "" while there may be one. now_s: time.monotonic()."""


class Selftest:
    """The chips' own test, started at once; SourceError where the source has none."""

    def __init__(self, pad: str, source: Source, pad_index: int) -> None:
        self._pad = pad
        self._source = source
        self._pad_index = pad_index
        source.request_selftest(pad_index)
        self._begun_s = time.monotonic()

    hint = ""

    @property
    def share(self) -> float:
        return min((time.monotonic() - self._begun_s) / USUAL_SELFTEST_S, 1.0)

    def facts(self) -> dict[str, Any] | None:
        result = self._source.selftest_result(self._pad_index)
        return None if result is None else {"pad": self._pad, **result}

    def problem(self, now_s: float) -> str:
        if not self._source.state.connected:
            return f"{self._source.state.reason}: no self-test"
        return f"no self-test within {SELFTEST_S:g} s" if now_s - self._begun_s > SELFTEST_S else ""
