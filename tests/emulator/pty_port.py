"""The far end of a serial port, for an emulated machine or gauge: bytes out, whole lines in, and a plug to pull."""

from __future__ import annotations

import fcntl
import os
import select
import sys
import termios
import time
import tty
from pathlib import Path

FULL = 4000  # the kernel's buffer holds 4095 bytes, and stays full while nobody reads
PATIENCE_S = 5.0


class PtyPort:
    """`link` is where it is found. Unplugged, the program that has it open gets a hang-up. lockstep: nobody reads while
    this end writes, and its bytes can be read when `write` returns.
    """

    def __init__(self, link: Path) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        link.unlink(missing_ok=True)  # left by a bench that was killed
        link.symlink_to(os.ttyname(self._slave))
        self.lockstep = False

    def read(self, timeout_s: float) -> bytes:
        """The bytes that arrived, after at most this long."""
        if self.master < 0 or not select.select([self.master], [], [], timeout_s)[0]:
            return b""
        try:
            return os.read(self.master, 4096)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> None:
        """Bytes that do not fit are lost, as on a line that nobody reads."""
        if self.master < 0:
            return
        there = self._readable()
        try:
            written = os.write(self.master, data)
        except BlockingIOError:
            return
        # The kernel hands bytes over later, and much later on a busy computer.
        end_s = time.monotonic() + PATIENCE_S
        while self.lockstep and self._readable() < min(there + written, FULL) and time.monotonic() < end_s:
            time.sleep(0.0)

    def _readable(self) -> int:
        return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4)), sys.byteorder)

    def unplug(self) -> None:
        for end in (self.master, self._slave):
            if end >= 0:
                os.close(end)
        self.master = self._slave = -1
