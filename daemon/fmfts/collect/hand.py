"""A person presses: told where and how hard, heard by the gauge, or asked for the force that a display shows."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable
from typing import TextIO

from fmfts.collect.errors import StoppedError
from fmfts.collect.plan import Press
from fmfts.collect.watch import Watch

RELEASED_N = 0.05
STEADY_S = 0.3  # a hand that was on the force for so long holds it
PATIENCE_S = 600.0
HEARD_S = 0.1  # what the mean force of a moment is of


class Hand:
    """A Presser. typed_n: the force of the last press where it was typed, None where a gauge tells it.

    say: where what to do is said. answers: where typed lines come from.
    """

    description = "by hand"

    def __init__(
        self, watch: Watch, tolerance: float, say: Callable[[str], None], *, gauge: bool, answers: TextIO = sys.stdin
    ) -> None:
        self.typed_n: float | None = None
        self._watch = watch
        self._tolerance = tolerance
        self._say = say
        self._gauge = gauge
        self._answers = answers

    def begin(self) -> None:
        """Nothing to get ready."""

    def stand_over(self, press: Press) -> None:
        if not self._gauge:
            self._say("take your hands off the pad, and press Enter")
            self._answer()
            return
        self._say("take your hands off the pad")
        self._held(lambda: abs(self._raw_force_n() - self._watch.tare_n) < RELEASED_N)

    def press(self, press: Press) -> None:
        target = f"{press.force_n:.2f} N at x {press.x_m * 1e3:+.1f}, y {press.y_m * 1e3:+.1f} mm"
        if self._gauge:
            self._say(f"press {target}, and hold")
            near_n = max(self._tolerance * press.force_n, RELEASED_N)
            self._held(lambda: abs(self._raw_force_n() - self._watch.tare_n - press.force_n) < near_n)
            self._say("hold")
            return
        self._say(f"press {target}, type the force in N, press Enter, and hold")
        while True:
            try:
                self.typed_n = float(self._answer().replace(",", "."))
                return
            except ValueError:
                self._say("that was no number: the force in N, and Enter")

    def lift(self) -> None:
        self._say("let go")

    def release(self) -> str:
        return "let go of the pad"

    def close(self) -> None:
        """A hand needs no closing."""

    def _raw_force_n(self) -> float:
        since_ns = self._watch.clock.now_ns() - round(HEARD_S * 1e9)
        forces = self._watch.forces_since(since_ns)
        return sum(forces) / len(forces) if forces else float("nan")

    def _held(self, there: Callable[[], bool]) -> None:
        """Until it was so for STEADY_S without a break."""
        begun_s: float | None = None

        def steady() -> bool:
            nonlocal begun_s
            now_s = self._watch.clock.now_ns() * 1e-9
            begun_s = (begun_s or now_s) if there() else None
            return begun_s is not None and now_s - begun_s >= STEADY_S

        if not self._watch.until(steady, PATIENCE_S):
            raise StoppedError(f"nobody pressed for {PATIENCE_S:g} s")

    def _answer(self) -> str:
        """The next line that is typed, while frames are still heard."""
        descriptor = self._answers.fileno()
        waiting = lambda: bool(select.select([descriptor], [], [], 0)[0])  # noqa: E731
        if not self._watch.until(waiting, PATIENCE_S):
            raise StoppedError(f"nobody answered for {PATIENCE_S:g} s")
        line = b""
        while not line.endswith(b"\n"):
            byte = os.read(descriptor, 1)
            if not byte:
                raise StoppedError("nobody is there to answer: standard input is closed")
            line += byte
        return line.decode("utf-8", "replace").strip()
