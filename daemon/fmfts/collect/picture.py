"""The grid filling in: every place of the plan, what is pressed now, and the time that is left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table as Grid
from rich.text import Text

from fmfts.collect.plan import Plan, Press

COLUMNS, ROWS = 41, 21  # a place's cell; a row is twice as high as a column is wide
DONE, PART, LEFT, NOW = ("●", "green"), ("◐", "yellow"), ("·", "bright_black"), ("◉", "bold red")


@dataclass
class Picture:
    """done: the numbers of finished presses. now: the press that is under way. said: what a person is to do."""

    plan: Plan
    done: set[int]
    now: Press | None = None
    said: str = ""
    begun_s: float = field(default_factory=time.monotonic)
    begun_with: int = field(init=False)

    def __post_init__(self) -> None:
        self.begun_with = len(self.done)

    def render(self) -> RenderableType:
        grid = Grid.grid(padding=(0, 2))
        grid.add_row(self._places(), self._facts())
        return Group(grid, Text(self.said or " ", "bold"))

    @property
    def seconds_left(self) -> float | None:
        """At the pace so far; None before the first press."""
        made = len(self.done) - self.begun_with
        if made == 0:
            return None
        return (time.monotonic() - self.begun_s) / made * (len(self.plan.presses) - len(self.done))

    def sentence(self) -> str:
        left_s = self.seconds_left
        left = "" if left_s is None else f", {_minutes(left_s)} left"
        return f"{len(self.done)} of {len(self.plan.presses)} presses{left}"

    def _places(self) -> Text:
        half_m = max(max(abs(press.x_m), abs(press.y_m)) for press in self.plan.presses) or 1e-3
        cells: dict[tuple[int, int], list[int]] = {}
        for press in self.plan.presses:
            cells.setdefault(_cell(press, half_m), []).append(press.number)
        now = None if self.now is None else _cell(self.now, half_m)
        text = Text()
        for row in range(ROWS):
            for column in range(COLUMNS):
                text.append(*self._mark(cells.get((column, row)), (column, row) == now))
            text.append("\n" if row < ROWS - 1 else "")
        return text

    def _mark(self, numbers: list[int] | None, now: bool) -> tuple[str, str]:
        if not numbers:
            return " ", ""
        finished = sum(number in self.done for number in numbers)
        return NOW if now else DONE if finished == len(numbers) else PART if finished else LEFT

    def _facts(self) -> Grid:
        facts = Grid.grid(padding=(0, 1))
        facts.add_row("plan", self.plan.name)
        facts.add_row("presses", self.sentence())
        facts.add_row("", ProgressBar(len(self.plan.presses), len(self.done), width=30))
        if self.now is not None:
            facts.add_row("now", f"{self.now.force_n:.3f} N")
            facts.add_row("", f"at ({self.now.x_m * 1e3:+.1f}, {self.now.y_m * 1e3:+.1f}) mm")
        return facts


@contextmanager
def shown(picture: Picture) -> Iterator[Callable[[], None]]:
    """Within it, call what it gives whenever the picture has changed. Where nobody looks, a line for each place."""
    if not sys.stderr.isatty():
        place: tuple[float, float] | None = None
        said = ""

        def line() -> None:
            nonlocal place, said
            if picture.now is not None and picture.now.place_m != place:
                place = picture.now.place_m
                print(picture.sentence(), file=sys.stderr, flush=True)
            if picture.said not in ("", said):
                print(picture.said, file=sys.stderr, flush=True)
            said = picture.said

        yield line
        return
    with Live(picture.render(), console=Console(stderr=True), auto_refresh=False) as live:
        yield lambda: live.update(picture.render(), refresh=True)


def _cell(press: Press, half_m: float) -> tuple[int, int]:
    """Column and row; y points up."""
    column = round((press.x_m / half_m + 1.0) / 2.0 * (COLUMNS - 1))
    row = round((1.0 - press.y_m / half_m) / 2.0 * (ROWS - 1))
    return column, row


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
