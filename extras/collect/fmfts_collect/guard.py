"""Lifts the rod, in a process of its own, when the collector hangs, crashes or is killed with the rod down.

The guard shares the machine's serial port and a pipe with the collector. While the rod is down, the collector writes
DOWN into the pipe at each poll, 20 times a second at most; when the rod is up again, UP; before it ends by itself,
DONE. The guard lifts the rod when the pipe is closed without DONE, and when nothing comes for HANG_S after DOWN. With
the rod up the collector may wait as long as it likes. After a hang the guard closes the pipe, and so a collector that
goes on later learns that the rod was lifted. The bytes that the guard sends were prepared before, so that little can
go wrong. It keeps the port open: closing it resets many boards.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from fmfts_collect.errors import StoppedError

DOWN, UP, DONE = b"d", b"u", b"."
GOOD, NOT_LIFTED = 0, 1  # exit codes
BEAT_S = 0.05
HANG_S = 1.0  # a collector polls each millisecond; on a busy computer a poll may be some tenths of a second late
PATIENCE_S = 2.0
TURN_S = 0.01


@dataclass(frozen=True, slots=True)
class Rescue:
    """Bytes to send in turn, and the wait after each in s."""

    steps: tuple[tuple[bytes, float], ...]


class Guard:
    """A guard process for the machine on `port` (a file descriptor), until `close`."""

    def __init__(self, port: int, rescue: Rescue) -> None:
        self._hang_s = HANG_S
        words = [str(port), f"{HANG_S:g}", *(f"{data.hex()}:{seconds:.3f}" for data, seconds in rescue.steps)]
        # A session of its own, so that Ctrl-C and a closed terminal do not end the guard.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fmfts_collect.guard", *words],
            stdin=subprocess.PIPE,
            pass_fds=(port,),
            start_new_session=True,
        )
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._beat, self._beat_s = UP, time.monotonic()

    @property
    def pid(self) -> int:
        return self._process.pid

    def beat(self, *, down: bool) -> None:
        """Report that the collector is alive, and whether the rod is down. StoppedError if the guard does not
        listen."""
        beat, now_s = (DOWN if down else UP), time.monotonic()
        if beat == self._beat and (not down or now_s - self._beat_s < BEAT_S):
            return
        self._beat, self._beat_s = beat, now_s
        try:
            os.write(self._pipe, beat)
        except BrokenPipeError as error:
            raise StoppedError("the guard of collect listens no more") from error
        except BlockingIOError as error:
            raise StoppedError("the guard of collect does not listen: was it stopped?") from error

    def why_lifted(self) -> str:
        """Why it sent the rod up; "" if it did not. Waits until the rod is up."""
        try:
            os.write(self._pipe, self._beat)
        except BrokenPipeError:
            if self._process.wait() == GOOD:
                return f"collect stood still for {self._hang_s:g} s: was it stopped, or is this computer too busy?"
        except BlockingIOError:
            pass  # the guard is alive but does not read
        return ""

    def close(self, *, lift: bool = False) -> None:
        """End the guard. lift: the rod is not lifted yet, so the guard does it first."""
        self._process.communicate(b"" if lift else DONE)


class _End(Enum):
    """How a collector ended."""

    DONE = "ended by itself"
    DIED = "ended with the rod down"
    HANGS = "stood still with the rod down"


def main(words: Sequence[str]) -> int:
    port, hang_s, steps = int(words[0]), float(words[1]), [word.split(":") for word in words[2:]]
    end = _wait(sys.stdin.fileno(), hang_s)
    if end is _End.DONE:
        return GOOD
    os.close(sys.stdin.fileno())
    said = f"collect stood still for {hang_s:g} s with the rod down" if end is _End.HANGS else f"collect {end.value}"
    try:
        for data, seconds in steps:
            _write(port, bytes.fromhex(data))
            time.sleep(float(seconds))
    except OSError as error:
        print(
            f"{said}, and it MAY STILL PRESS: {error.strerror}; lift it by hand",
            file=sys.stderr,
        )
        return NOT_LIFTED
    print(f"{said}: the rod was sent up", file=sys.stderr)
    return GOOD


def _wait(pipe: int, hang_s: float) -> _End:
    """Waits until the collector ends or hangs."""
    last = UP
    while True:
        if not select.select([pipe], [], [], hang_s if last == DOWN else None)[0]:
            return _End.HANGS
        received = os.read(pipe, 4096)
        if not received:
            return _End.DONE if last == DONE else _End.DIED
        last = received[-1:]


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
    sys.exit(main(sys.argv[1:]))
