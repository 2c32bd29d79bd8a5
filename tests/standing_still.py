"""When a processor of this computer stood still, whoever made it: a hypervisor that runs others, or a frozen container.

A test that judges what comes in time needs a witness that does not depend on what it judges.
"""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from typing import Self

NAP_S = 0.005
LONGEST_WAIT_S = 0.05  # for a processor, on a computer whose programs share it


class StandingStill:
    """One thread on each processor that sleeps and wakes; `times` (start, end) of CLOCK_MONOTONIC that it overslept."""

    def __init__(self) -> None:
        self.times: list[tuple[float, float]] = []
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=self._watch, args=(processor,), daemon=True)
            for processor in os.sched_getaffinity(0)
        ]

    @property
    def total_s(self) -> float:
        """Of all processors together: 0 where none stood still."""
        return sum(end - start for start, end in self.times)

    def within(self, start_s: float, end_s: float) -> bool:
        return any(start < end_s and start_s < end for start, end in self.times)

    def _watch(self, processor: int) -> None:
        os.sched_setaffinity(0, {processor})  # of this thread
        with suppress(PermissionError):  # only root goes before all programs; others wait for their turn
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        before_s = time.monotonic()
        while not self._closing.is_set():
            time.sleep(NAP_S)
            now_s = time.monotonic()
            if now_s - before_s > LONGEST_WAIT_S:
                self.times.append((before_s, now_s))
            before_s = now_s

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join()
