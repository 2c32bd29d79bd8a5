"""Lifts the rod, in a process of its own, when the collector dies with the rod down: by `kill -9`, or a crash.

The guard shares the machine's serial port and a pipe with the collector. It waits until the collector closes the pipe,
by ending or dying. If "done" came through the pipe before, it does nothing; otherwise it lifts the rod. The bytes that
it sends were prepared before, so that little can go wrong. It keeps the port open: closing it resets many boards.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

DONE = b"done"
PATIENCE_S = 2.0
TURN_S = 0.01


@dataclass(frozen=True, slots=True)
class Rescue:
    """Bytes to send in turn, and the wait after each in s."""

    steps: tuple[tuple[bytes, float], ...]


class Guard:
    """A guard process for the machine on `port` (a file descriptor), until `close`."""

    def __init__(self, port: int, rescue: Rescue) -> None:
        words = [str(port), *(f"{data.hex()}:{seconds:.3f}" for data, seconds in rescue.steps)]
        # A session of its own, so that Ctrl-C and a closed terminal do not end the guard.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fmfts.collect.guard", *words],
            stdin=subprocess.PIPE,
            pass_fds=(port,),
            start_new_session=True,
        )

    @property
    def pid(self) -> int:
        return self._process.pid

    def close(self, *, lift: bool = False) -> None:
        """End the guard. lift: the rod is not lifted yet, so the guard does it first."""
        self._process.communicate(b"" if lift else DONE)


def main(words: Sequence[str]) -> None:
    port, steps = int(words[0]), [word.split(":") for word in words[1:]]
    received = b""
    while more := os.read(sys.stdin.fileno(), 64):
        received += more
    if received == DONE:
        return
    try:
        for data, seconds in steps:
            _write(port, bytes.fromhex(data))
            time.sleep(float(seconds))
    except OSError as error:
        print(
            f"collect ended with the rod down, and it MAY STILL PRESS: {error.strerror}; lift it by hand",
            file=sys.stderr,
        )
        return
    print("collect ended with the rod down: the rod was sent up", file=sys.stderr)


def _write(port: int, data: bytes) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while data:
        try:
            data = data[os.write(port, data) :]
        except BlockingIOError:
            if time.monotonic() > end_s:
                raise
            time.sleep(TURN_S)


if __name__ == "__main__":
    main(sys.argv[1:])
