"""The firmware's own binary on the emulated chip, as a board for the daemon, and a finger that moves its magnet."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from emulator.pace import slowed
from end_to_end.processes import BRIDGE_CONFIG, ROOT, FirmwareHost, RunningDaemon
from fmfts.pad import Pad
from fmfts_client import Contact
from fmfts_simulation.finger import Finger
from fmfts_simulation.mounted import MountedPad

ELF = ROOT / "firmware" / "build" / "fmfts.elf"
RUNNER = ROOT / "tests" / "emulator" / "board_on_pty.py"
MOVES_A_SECOND = 100
EMULATED_CONFIG = BRIDGE_CONFIG + "rate_hz = 75\n"
PACE = 0.2  # share of real time: an emulated second costs up to three of a processor, and tests share it
PATIENCE_S = 120.0


class SlowedDaemon(RunningDaemon):
    """A daemon and its verbs, for which time passes as for the emulated board."""

    def __init__(self, folder: Path, config: str) -> None:
        slower, self._begun_s = slowed(PACE), time.monotonic()
        super().__init__(folder, config, through=["env", *(f"{name}={value}" for name, value in slower.items())])
        self.environment |= slower

    def with_its_clock(self) -> dict[str, str]:
        """The environment of a process that starts now, and compares its time with that of messages."""
        return self.environment | slowed(PACE, self._begun_s)

    def now_ns(self) -> int:
        return self.wait_for(lambda contact: True).t_publish_ns

    def wait_for(self, wanted: Callable[[Contact], bool], patience_s: float = PATIENCE_S) -> Contact:
        return super().wait_for(wanted, patience_s)


class EmulatedBoard(FirmwareHost):
    """Takes the same commands as the host build; `port` is a link to its pty."""

    def __init__(self, folder: Path, *options: str) -> None:
        subprocess.run(
            ["make", "--no-print-directory", "-C", ROOT / "firmware", "stm32"], check=True, capture_output=True
        )
        self.port = folder / "board"
        self._process = subprocess.Popen(
            [sys.executable, RUNNER, ELF, "--link", self.port, "--pace", str(PACE), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        assert first.startswith("pty: "), first


class PressedPad:
    """Presses the board's pad as `finger` defines, in real time; before `press` nothing touches it.

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

    def __enter__(self) -> PressedPad:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._thread:
            self._thread.join()
