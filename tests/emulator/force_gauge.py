"""An ASCII force gauge on a pty or in datagrams: a rate, noise, delay, and drop-outs. Its time passes by `turn`."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from emulator.pty_port import PtyPort


class ForceGauge:
    """Writes the force of `delay_s` ago. dropout: the share of readings that are lost. silent: all are lost."""

    def __init__(
        self,
        force_n: Callable[[], float],
        write: Callable[[bytes], None],
        *,
        rate_hz: float = 80.0,
        noise_n: float = 0.0,
        delay_s: float = 0.0,
        dropout: float = 0.0,
        offset_n: float = 0.137,  # no gauge shows zero with a rod on it
        seed: int = 1,
    ) -> None:
        self.silent = False
        self.noise_n, self.delay_s, self.dropout = noise_n, delay_s, dropout
        self._force_n = force_n
        self._write = write
        self.rate_hz = rate_hz
        self.shown = ""  # instead of the force
        self._offset_n = offset_n
        self._random = np.random.default_rng(seed)
        self._past: deque[tuple[float, float]] = deque()
        self._now = self._due = 0.0

    def __enter__(self) -> ForceGauge:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing runs."""

    def turn(self, seconds: float) -> None:
        """Let this much time pass."""
        self._now += seconds
        force_n = self._delayed(self._now)
        while self._due <= self._now:
            self._due += 1.0 / self.rate_hz
            if not self.silent and self._random.random() >= self.dropout:
                shown = force_n + self._offset_n + self.noise_n * self._random.standard_normal()
                self._write(f"ST,GS,{self.shown or f'{shown:+08.4f}'} N\r\n".encode())

    def _delayed(self, now: float) -> float:
        self._past.append((now, self._force_n()))
        while len(self._past) > 1 and self._past[1][0] <= now - self.delay_s:
            self._past.popleft()
        return self._past[0][1]


class SerialForceGauge(ForceGauge):
    """On a pty; `unplug` hangs it up."""

    def __init__(self, link: Path, force_n: Callable[[], float], **options: float) -> None:
        self.port = PtyPort(link)
        super().__init__(force_n, self.port.write, **options)

    def unplug(self) -> None:
        self.port.unplug()

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self.port.unplug()


class UdpForceGauge(ForceGauge):
    """In datagrams to a port of this machine."""

    def __init__(self, port: int, force_n: Callable[[], float], **options: float) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        super().__init__(force_n, lambda data: self._socket.sendto(data, ("127.0.0.1", port)) and None, **options)

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._socket.close()
