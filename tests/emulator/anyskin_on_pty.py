"""A board with AnySkin's own firmware on a pty."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from emulator.pty_port import PtyPort

NOISE_UT = 0.6


class Board:
    """Sends packets on a pty at a steady rate, in a thread. field_t (N, 3): of its magnetometers."""

    def __init__(self, folder: Path, rate_hz: float, form: Callable[..., bytes]) -> None:
        self.link = folder / "skin"
        self.field_t = np.zeros((5, 3))
        self.damage: Callable[[bytes], bytes] | None = None  # of the next packet
        self.line: Callable[[bytes], bytes] = bytes  # decides what happens to every packet on its way
        self.sent = 0
        self._port = PtyPort(self.link)
        self._rate_hz, self._form = rate_hz, form
        self._random = np.random.default_rng(1)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        start_s = time.monotonic()
        while not self._ended.is_set():
            noisy = self.field_t * 1e6 + self._random.normal(0.0, NOISE_UT, self.field_t.shape)
            packet = self._form(noisy.tolist(), 25.0)
            damage, self.damage = self.damage, None
            self._port.write(self.line(damage(packet) if damage else packet))
            self.sent += 1
            time.sleep(max(0.0, start_s + self.sent / self._rate_hz - time.monotonic()))

    def __enter__(self) -> Board:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.pull()

    def pull(self) -> None:
        self._ended.set()
        self._thread.join()
        self._port.unplug()
        self.link.unlink(missing_ok=True)
