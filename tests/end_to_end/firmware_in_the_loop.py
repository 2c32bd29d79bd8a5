"""The firmware's own binary on the emulated chip, as a board for the daemon, and a finger that moves its magnet."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Self

import numpy as np

from end_to_end.processes import BRIDGE_CONFIG, ROOT, FirmwareHost
from fmfts.pad import Pad
from fmfts.simulation.finger import Finger
from fmfts.simulation.mounted import MountedPad

ELF = ROOT / "firmware" / "build" / "fmfts.elf"
RUNNER = ROOT / "tests" / "emulator" / "board_on_pty.py"
MOVES_A_SECOND = 100
# A frame costs about 4 ms of a processor, twice that on a slow one. At 220 Hz the board's clock would stand now and
# then, and the daemon leaves late frames out; tests/firmware/test_emulator_stream.py has 220 Hz, in the board's time.
EMULATED_CONFIG = BRIDGE_CONFIG + "rate_hz = 75\n"


class EmulatedBoard(FirmwareHost):
    """Takes the same commands as the host build; `port` is a link to its pty."""

    def __init__(self, folder: Path, *options: str) -> None:
        subprocess.run(
            ["make", "--no-print-directory", "-C", ROOT / "firmware", "stm32"], check=True, capture_output=True
        )
        self.port = folder / "board"
        self._process = subprocess.Popen(
            [sys.executable, RUNNER, ELF, "--link", self.port, *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        assert first.startswith("pty: "), first


class PressedPad:
    """Presses the board's pad as `finger` says, in real time; before `press` nothing touches it.

    ambient_t: uniform field (3,) besides the magnet's, in pad axes.
    """

    def __init__(self, board: FirmwareHost, pad: Pad, ambient_t: np.ndarray | float = 0.0) -> None:
        self._board = board
        self._ambient_t = ambient_t
        self._mounted = MountedPad.exact(pad)
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self.touch(0.0, 0.0, 0.0)

    def touch(self, x_m: float, y_m: float, force_n: float) -> None:
        sensors = len(self._mounted.pad.sensors)
        press = (np.full(sensors, value) for value in (x_m, y_m, force_n))
        self._board.field(self._mounted.sensed(self._mounted.magnet_field(*press) + self._ambient_t))

    def press(self, finger: Finger) -> None:
        def follow() -> None:
            begun = time.monotonic()
            while not self._over.wait(1.0 / MOVES_A_SECOND):
                self.touch(*finger(time.monotonic() - begun)[:3])

        self._thread = threading.Thread(target=follow, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._thread:
            self._thread.join()
