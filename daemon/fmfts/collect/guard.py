"""A small process that lifts the rod when the collector ends without having done so: after `kill -9`, or a crash.

It shares the machine's serial port and a pipe with the collector. As long as the collector lives, the pipe is open and
nothing is done; "done" in it, and all was well; closed without, and the rod goes up. What it writes was made ready
before, so that there is nothing left to go wrong. The port stays open meanwhile: closing it resets many boards.
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
    """What is sent in turn, and how long is waited after each (s)."""

    steps: tuple[tuple[bytes, float], ...]


class Guard:
    """Watches over the machine on `port` (a file descriptor) from now on, until `close`."""

    def __init__(self, port: int, rescue: Rescue) -> None:
        words = [str(port), *(f"{data.hex()}:{seconds:.3f}" for data, seconds in rescue.steps)]
        # In a session of its own: Ctrl-C and a closed terminal reach the collector alone.
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
        """It is not needed any more; or, where lifting was not brought to an end, it does it now."""
        self._process.communicate(b"" if lift else DONE)


def main(words: Sequence[str]) -> None:
    port, steps = int(words[0]), [word.split(":") for word in words[1:]]
    heard = b""
    while more := os.read(sys.stdin.fileno(), 64):
        heard += more
    if heard == DONE:
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
