"""Shows progress on stderr: a bar on a terminal, elsewhere a line for each new hint."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Show(Protocol):
    def __call__(self, share: float, hint: str = "") -> None: ...


def unseen(share: float, hint: str = "") -> None:
    """A Show that shows nothing."""


@contextmanager
def progress_bar(text: str) -> Iterator[Show]:
    """Yields a function; call it with the share of the work that is done, 0 to 1, and a hint for the person, or ""."""
    if not sys.stderr.isatty():
        said = ""

        def say(share: float, hint: str = "") -> None:
            nonlocal said
            if hint and hint != said:
                said = hint
                print(f"{text}: {hint}", file=sys.stderr, flush=True)

        yield say
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        bar = bars.add_task(text, total=1.0)

        def update(share: float, hint: str = "") -> None:
            bars.update(bar, completed=share, description=hint or text)

        yield update
