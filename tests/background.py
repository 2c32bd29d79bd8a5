"""A job that runs beside a test, in a thread of its own."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def repeating(turn: Callable[[], None], period_s: float) -> Iterator[None]:
    """Call `turn` again and again until the block ends."""
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


@contextmanager
def started(command: Sequence[str | Path], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A program that is killed when the block ends. Popen's own block waits for ever where a test failed in it."""
    with subprocess.Popen(command, text=True, **options) as process:
        try:
            yield process
        finally:
            process.kill()
