"""Records when a processor or a pty of this computer stood still, whatever the cause: a hypervisor, a frozen container,
a program.

A test that judges timing needs a witness independent of the system under test.
"""

from __future__ import annotations

import os
import threading
import time
import tty
from contextlib import suppress

NAP_S = 0.005
LONGEST_WAIT_S = 0.05  # for a processor, on a computer whose programs share it
LONGEST_ON_A_PTY_S = 0.01  # a kernel's worker of ordinary priority carries the bytes; the daemon waits 15 ms for frames


class StandingStill:
    """One thread on each processor that sleeps and wakes; `times` (start, end) of CLOCK_MONOTONIC that it overslept.

    pty: also when a byte was delayed on a pty, which carries an emulated board's bytes.
    """

    def __init__(self, pty: bool = False) -> None:
        self.times: list[tuple[float, float]] = []
        self._longest_wait_s = LONGEST_ON_A_PTY_S if pty else LONGEST_WAIT_S
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=self._watch, args=(processor,), daemon=True)
            for processor in os.sched_getaffinity(0)
        ]
        if pty:
            self._threads.append(threading.Thread(target=self._watch_a_pty, daemon=True))

    @property
    def total_s(self) -> float:
        """For all processors together: 0 if none stood still."""
        return sum(end - start for start, end in self.times)

    def within(self, start_s: float, end_s: float) -> bool:
        return any(start < end_s and start_s < end for start, end in self.times)

    def _watch(self, processor: int) -> None:
        os.sched_setaffinity(0, {processor})  # of this thread
        _go_first()
        before_s = time.monotonic()
        while not self._closing.is_set():
            time.sleep(NAP_S)
            now_s = time.monotonic()
            if now_s - before_s > self._longest_wait_s:
                self.times.append((before_s, now_s))
            before_s = now_s

    def _watch_a_pty(self) -> None:
        _go_first()
        master, slave = os.openpty()
        tty.setraw(slave)
        while not self._closing.is_set():
            time.sleep(NAP_S)
            before_s = time.monotonic()
            os.write(master, b"?")
            os.read(slave, 1)
            if (now_s := time.monotonic()) - before_s > self._longest_wait_s:
                self.times.append((before_s, now_s))
        os.close(master)
        os.close(slave)

    def __enter__(self) -> StandingStill:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join()


def _go_first() -> None:
    """Give this thread priority over all programs; only root may, others wait for their turn."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
