"""An emulated board whose pad is pressed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drills.pressed_pad import PressedPad
from end_to_end.processes import FirmwareHost

NEVER_NS = 1 << 62


class PressedBoard(FirmwareHost, PressedPad):
    def __init__(self, folder: Path, seed: int = 5) -> None:
        PressedPad.__init__(self, seed)
        self._folder = folder
        self.plug()

    def plug(self) -> None:
        """Plug it in again, as another pty; the pad keeps its state."""
        FirmwareHost.__init__(self, self._folder)
        self._move(self._touch)

    def is_plugged(self) -> bool:
        return self._process.poll() is None

    @contextmanager
    def held(self) -> Iterator[None]:
        """The board's time stands still, and so does the finger; frames made up for afterwards come late."""
        self.tell("hold on")
        self._pressed, pressed = False, self._pressed
        self._begun_ns.append(time.monotonic_ns())
        self._done_ns.append(NEVER_NS)
        self._touches.append(self._touch)
        yield
        self.tell("hold off")
        self._done_ns[-1] = time.monotonic_ns()
        self._pressed = pressed
