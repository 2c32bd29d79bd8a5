"""Shows the progress of collecting: all places of the plan, the present press, and the time that is left."""

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

from fmfts_collect.plan import Plan, Press

COLUMNS, ROWS = 41, 21  # for places that form no lattice; a row is twice as high as a column is wide
REFRESHED_HZ = 5
Cell = tuple[int, int]  # column and row; y points up
DONE, PART, LEFT, NOW = ("●", "green"), ("◐", "yellow"), ("·", "bright_black"), ("◉", "bold red")


@dataclass
class Picture:
    """The state of the work, and its picture.

    done: numbers of the finished presses. now: the present press. said: instruction to the person who presses.
    force_n: returns the present force; None where it is not known.
    """

    plan: Plan
    done: set[int]
    now: Press | None = None
    said: str = ""
    begun_s: float = field(default_factory=time.monotonic)
    force_n: Callable[[], float | None] = lambda: None
    begun_with: int = field(init=False)
    _cells: dict[int, Cell] = field(init=False)

    def __post_init__(self) -> None:
        self.begun_with = len(self.done)
        self._cells = cells_of(self.plan)

    def render(self) -> RenderableType:
        grid = Grid.grid(padding=(0, 2))
        grid.add_row(self._places(), self._facts())
        return Group(grid, Text(self.said or " ", "bold"))

    @property
    def seconds_left(self) -> float | None:
        """Time left at the present pace; None before the first press."""
        newly_done = len(self.done) - self.begun_with
        if newly_done == 0:
            return None
        return (time.monotonic() - self.begun_s) / newly_done * (len(self.plan.presses) - len(self.done))

    def sentence(self) -> str:
        left_s = self.seconds_left
        left = "" if left_s is None else f", {_minutes(left_s)} left"
        return f"{len(self.done)} of {len(self.plan.presses)} presses{left}"

    def _places(self) -> Text:
        presses: dict[Cell, list[int]] = {}
        for number, cell in self._cells.items():
            presses.setdefault(cell, []).append(number)
        now = None if self.now is None else self._cells[self.now.number]
        text = Text()
        for row in range(1 + max(row for _, row in presses)):
            for column in range(1 + max(column for column, _ in presses)):
                text.append(*self._mark(presses.get((column, row)), (column, row) == now))
            text.append("\n")
        text.append("x to the right, y up", "bright_black")
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
        force_n = self.force_n()
        if force_n is not None:
            facts.add_row("force", f"{force_n:.3f} N")
        return facts


@contextmanager
def shown(picture: Picture) -> Iterator[Callable[[], None]]:
    """Yields a function; call it when the picture has changed. Without a terminal it prints a line for each place."""
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
    with Live(get_renderable=picture.render, console=Console(stderr=True), refresh_per_second=REFRESHED_HZ) as live:
        yield live.refresh


def cells_of(plan: Plan) -> dict[int, Cell]:
    """Number of each press → the cell where it is drawn. A lattice gets evenly spaced rows and columns."""
    xs, ys = (sorted({place[axis] for place in (press.place_m for press in plan.presses)}) for axis in (0, 1))
    if len(xs) <= ROWS and len(ys) <= ROWS:
        column, row = {x: 2 * i for i, x in enumerate(xs)}, {y: i for i, y in enumerate(reversed(ys))}
        return {press.number: (column[press.x_m], row[press.y_m]) for press in plan.presses}
    half_m = max(map(abs, (*xs, *ys))) or 1e-3
    return {
        press.number: (
            round((press.x_m / half_m + 1.0) / 2.0 * (COLUMNS - 1)),
            round((1.0 - press.y_m / half_m) / 2.0 * (ROWS - 1)),
        )
        for press in plan.presses
    }


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
