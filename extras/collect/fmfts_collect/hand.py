"""Lets a person press: says where and how hard, and reads the gauge, or asks for the force that a display shows."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable
from statistics import fmean, pstdev
from typing import TextIO

from fmfts_collect.errors import StoppedError
from fmfts_collect.plan import Press
from fmfts_collect.watch import Watch

RELEASED_N = 0.05
STEADY_S = 0.3  # the force counts as held after this time
PATIENCE_S = 600.0
MEAN_S = 0.1  # the present force is the mean over this time


class Hand:
    """A Presser. typed_n: the force of the last press, if the person typed it; None where a gauge measures it.

    say: shows an instruction. gauge: a gauge measures the force. answers: typed lines.
    """

    description = "by hand"

    def __init__(
        self,
        watch: Watch,
        tolerance: float,
        say: Callable[[str], None],
        *,
        gauge: bool,
        answers: TextIO = sys.stdin,
    ) -> None:
        self.typed_n: float | None = None
        self._watch = watch
        self._tolerance = tolerance
        self._say_to_person = say
        self._gauge = gauge
        self._answers = answers
        self._reason_to_repeat = ""
        self._zero_is_known = False

    def begin(self) -> None:
        """Nothing to get ready."""

    def stand_over(self, press: Press) -> None:
        if not self._gauge:
            self._say("take your hands off the pad, and press Enter")
            self._answer()
            return
        self._say("take your hands off the pad")
        if not self._held(self._is_let_go):
            raise StoppedError(f"the gauge shows no untouched pad for {PATIENCE_S:g} s: {self._reading()}")

    def press(self, press: Press) -> None:
        self._zero_is_known = True
        target = f"{press.force_n:.2f} N at x {press.x_m * 1e3:+.1f}, y {press.y_m * 1e3:+.1f} mm"
        if self._gauge:
            self._say(f"press {target}, and hold")
            near_n = max(self._tolerance * press.force_n, RELEASED_N)
            if not self._held(lambda: abs(self._force_n() - press.force_n) < near_n):
                raise StoppedError(f"{press.force_n:.2f} N was not measured for {PATIENCE_S:g} s: {self._reading()}")
            self._say("hold")
            return
        self._say(f"press {target}, type the force in N, press Enter, and hold")
        while True:
            try:
                self.typed_n = float(self._answer().replace(",", "."))
                return
            except ValueError:
                self._say("that was not a number: type the force in N, and press Enter")

    def refused(self, why: str, times: int, once_more: Callable[[], None]) -> None:
        """Say why, and let the person press again, without a limit."""
        self._reason_to_repeat = why
        once_more()

    def lift(self) -> None:
        self._say("let go")

    def release(self) -> str:
        return "nothing presses" if self._gauge and self._is_let_go() else "let go of the pad"

    def close(self) -> None:
        """A hand needs no closing."""

    def _say(self, text: str) -> None:
        self._say_to_person(f"once more ({self._reason_to_repeat}): {text}" if self._reason_to_repeat else text)
        self._reason_to_repeat = ""

    def _is_let_go(self) -> bool:
        """Is the force zero? Until the zero is known: is it steady? (The field shows then that nothing presses.)"""
        if self._zero_is_known:
            return abs(self._force_n()) < RELEASED_N
        forces = self._forces(STEADY_S)
        return len(forces) > 1 and pstdev(forces) < RELEASED_N

    def _forces(self, seconds: float) -> list[float]:
        return self._watch.forces_since(self._watch.clock.now_ns() - round(seconds * 1e9))

    def _force_n(self) -> float:
        forces = self._forces(MEAN_S)
        return fmean(forces) - self._watch.tare_n if forces else float("nan")

    def _reading(self) -> str:
        return f"it reads {self._force_n():.3f} N; are its unit and its zero right?"

    def _held(self, condition: Callable[[], bool]) -> bool:
        """Waits until `condition` has held for STEADY_S without a break; False after PATIENCE_S."""
        begun_s: float | None = None

        def steady() -> bool:
            nonlocal begun_s
            now_s = self._watch.clock.now_ns() * 1e-9
            begun_s = (begun_s or now_s) if condition() else None
            return begun_s is not None and now_s - begun_s >= STEADY_S

        return self._watch.until(steady, PATIENCE_S)

    def _answer(self) -> str:
        """The next typed line; receives frames while it waits."""
        descriptor = self._answers.fileno()
        is_typed = lambda: bool(select.select([descriptor], [], [], 0)[0])  # noqa: E731
        if not self._watch.until(is_typed, PATIENCE_S):
            raise StoppedError(f"nobody answered for {PATIENCE_S:g} s")
        line = b""
        while not line.endswith(b"\n"):
            byte = os.read(descriptor, 1)
            if not byte:
                raise StoppedError("nobody is there to answer: standard input is closed")
            line += byte
        return line.decode("utf-8", "replace").strip()
