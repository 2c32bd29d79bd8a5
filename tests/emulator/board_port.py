"""What an emulated board needs to be a process of its own: a pty as its port, and commands on standard input."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import tty
from collections.abc import Callable
from pathlib import Path


class WrongCommandError(Exception):
    """A command that is refused and changes nothing; the text says why."""


class Pty:
    """The host's serial port. If no program has it open, the board's bytes are lost. If the program is too slow, bytes
    that do not fit are lost."""

    def __init__(self, link: Path | None) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(slave)
        os.close(slave)  # from now on a hang-up shows whether anyone has the port open
        self.link = link
        if link:
            if link.is_symlink():  # replace only a link: a mistyped path must not delete a file
                link.unlink()
            link.symlink_to(self.path)

    def is_open(self) -> bool:
        """True if a program has it open."""
        poll = select.poll()
        poll.register(self.master, select.POLLIN)
        return not any(events & select.POLLHUP for _, events in poll.poll(0))

    def exchange(self, data: bytes) -> bytes:
        """Pass on the board's bytes; returns the host's."""
        if not self.is_open():
            return b""
        if data:
            with contextlib.suppress(BlockingIOError):
                os.write(self.master, data)
        try:
            return os.read(self.master, 4096)
        except (BlockingIOError, OSError):
            return b""

    def close(self) -> None:
        if self.link and self.link.is_symlink() and os.readlink(self.link) == self.path:
            self.link.unlink()
        os.close(self.master)


class Orders:
    """Lines on standard input, without ever waiting for them; closed: `ended`."""

    def __init__(self) -> None:
        self.ended = False
        self._rest = b""

    def end(self) -> None:
        self.ended = True

    def lines(self) -> list[str]:
        if not select.select([sys.stdin], [], [], 0)[0]:
            return []
        data = os.read(sys.stdin.fileno(), 65536)
        self.ended |= not data
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [line.decode(errors="replace") for line in lines]

    def obey(self, execute: Callable[[str], None]) -> None:
        for line in self.lines():
            if line.strip() == "quit":
                self.end()
                return
            try:
                execute(line)
                print("ok", flush=True)
            except WrongCommandError as wrong:
                print(f"error: {wrong}", flush=True)
