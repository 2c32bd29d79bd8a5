"""What goes on beside a test, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def repeating(turn: Callable[[], None], period_s: float) -> Iterator[None]:
    """`turn` again and again, until the block ends."""
    done = threading.Event()

    def loop() -> None:
        while not done.wait(period_s):
            turn()

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
