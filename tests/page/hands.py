"""Two hands for the firmware on a pty: they hold its pad still, turn it, or press it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from end_to_end.first_use import EARTH_T
from end_to_end.processes import FirmwareHost
from fmfts.pad import Pad, rotation_from_vector
from fmfts_simulation.finger import Touch, no_finger
from fmfts_simulation.mounted import MountedPad

STEP_S, LONGEST_STEP_S = 0.005, 0.05
SWAY_RAD, SWAY_RAD_PER_S = np.array([1.5, 1.5, 2.4]), np.array([0.5, 0.37, 0.31])
Turn = Callable[[float], np.ndarray]


def unturned(time_s: float) -> np.ndarray:
    return np.eye(3)


def swaying(time_s: float) -> np.ndarray:
    """A robot that sways slowly about all three axes."""
    return rotation_from_vector(SWAY_RAD * np.sin(SWAY_RAD_PER_S * time_s))


class HandledBoard:
    """A board whose field follows the hands.

    A busy computer delays the hands but not the board. They then continue from where they were: if they made up for
    long stops, the field would jump, which looks like a touch between the samples of two chips.
    """

    def __init__(self, folder: Path) -> None:
        self.board = FirmwareHost(folder)
        self._next: Callable[[float], np.ndarray] = lambda time_s: EARTH_T
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def take_off(self) -> None:
        """No pad is mounted."""
        self._next = lambda time_s: EARTH_T

    def hold(self, pad: Pad, turn: Turn = unturned, finger: Callable[[float], Touch] = no_finger) -> None:
        """The pad is mounted. turn, finger: by the hands' seconds from now."""
        mounted = MountedPad.exact(pad)
        last: tuple[Touch, np.ndarray] | None = None

        def field(time_s: float) -> np.ndarray:
            nonlocal last
            touch = finger(time_s)
            if last is None or last[0] != touch:
                last = touch, mounted.magnet_field(*(np.full(len(pad.sensors), value) for value in touch[:3]))
            return mounted.sensed(last[1] + turn(time_s).T @ EARTH_T[0])

        self._next = field

    def _live(self) -> None:
        now, time_s, last_s = self._next, 0.0, time.monotonic()
        while not self._over.is_set():
            if now is not self._next:
                now, time_s = self._next, 0.0
            self.board.field(now(time_s))
            time.sleep(STEP_S)
            at_s = time.monotonic()
            time_s, last_s = time_s + min(at_s - last_s, LONGEST_STEP_S), at_s

    def __enter__(self) -> HandledBoard:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self.board.kill()
