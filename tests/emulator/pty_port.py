"""The far end of a serial port, for an emulated machine or gauge: bytes out, whole lines in, and a plug to pull."""

from __future__ import annotations

import os
import select
import tty
from pathlib import Path


class PtyPort:
    """`link` is where it is found. Unplugged, whoever has it open gets a hang-up."""

    def __init__(self, link: Path) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        link.symlink_to(os.ttyname(self._slave))
        self._rest = b""

    def read(self, timeout_s: float) -> bytes:
        """What has come, after at most so long."""
        if self.master < 0 or not select.select([self.master], [], [], timeout_s)[0]:
            return b""
        try:
            return os.read(self.master, 4096)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> None:
        """What does not fit is lost, as on a line that nobody reads."""
        if self.master < 0:
            return
        try:
            os.write(self.master, data)
        except BlockingIOError:
            return

    def unplug(self) -> None:
        for end in (self.master, self._slave):
            if end >= 0:
                os.close(end)
        self.master = self._slave = -1
