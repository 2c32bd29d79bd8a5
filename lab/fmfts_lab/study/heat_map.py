"""The stability study as pictures: red for wrong and unflagged, grey for flagged, white for right."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts.pad import Array
from fmfts_lab.study.harness import Row
from fmfts_lab.study.style import SMALL_PT, TEXT_PT, sheet

# Smaller shares get the colour of this one, so that a single wrong frame is visible.
FAINTEST = 0.25
# Dimension → what the rows and the columns of its map are, and what its title begins with.
PLANES = {
    "start error": ("the magnet jumps by", "its axis turns by", "A magnet that jumps"),
    "finger speed": ("a press lasts", "frames per second", "A fast finger"),
}
FOOT = "Red: wrong, and not flagged; the paler, the fewer of the frames. Grey: flagged. White: right."
LINE_INCH, WIDE_LINE_INCH, HEAD_INCH = 0.152, 0.23, 2.6  # rows of tables; the title and the methods' names
MAPS_ACROSS = 4


def figures(rows: Sequence[Row], default: str) -> Iterator[tuple[str, Figure]]:
    """Suffixes and figures: every method by dimension, by condition, and maps of the dimensions with two axes."""
    yield "", _overview(rows, default)
    yield "-conditions", _conditions(rows, default)
    for dimension in PLANES:
        own = [row for row in rows if row["dimension"] == dimension]
        if own:
            yield f"-{dimension.replace(' ', '-')}", _maps(own, dimension, default)


def _counted(rows: Sequence[Row], name: str) -> float:
    return sum(float(row[name] or 0) for row in rows)


def _colour(rows: Sequence[Row]) -> Array:
    """(3,) RGB of a cell that stands for these."""
    frames = _counted(rows, "frames") or 1.0
    wrong, flagged = _counted(rows, "wrong") / frames, _counted(rows, "flagged") / frames
    red = max(wrong, FAINTEST) if wrong else 0.0
    grey = 0.55 * flagged
    colour: Array = (1.0 - grey) * (1.0 - red) * np.ones(3) + red * np.array([0.85, 0.1, 0.1])
    return np.clip(colour, 0.0, 1.0)


def _table(axes: Axes, rows: Sequence[Row], line_of: Callable[[Row], object]) -> dict[tuple[object, str], list[Row]]:
    """A coloured cell for each line and method, the methods' names above. Returns the rows of each cell."""
    cells: dict[tuple[object, str], list[Row]] = {}
    for row in rows:
        cells.setdefault((line_of(row), str(row["method"])), []).append(row)
    lines, methods = (list(dict.fromkeys(key[part] for key in cells)) for part in (0, 1))
    picture = np.ones((len(lines), len(methods), 3))
    for (line, method), own in cells.items():
        picture[lines.index(line), methods.index(method)] = _colour(own)
    axes.imshow(picture, aspect="auto", interpolation="nearest", rasterized=True)
    axes.set_xticks(
        range(len(methods)),
        [str(method) for method in methods],
        fontsize=SMALL_PT,
        rotation=50,
        ha="left",
        rotation_mode="anchor",
    )
    axes.xaxis.tick_top()
    axes.set_xticks(np.arange(len(methods) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(lines) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="0.85", linewidth=0.5)
    axes.tick_params(which="both", length=0.0)
    return cells


def _overview(rows: Sequence[Row], default: str) -> Figure:
    """A row for each dimension. A cell's number is the share of its frames that is wrong, in per cent."""
    dimensions = list(dict.fromkeys(str(row["dimension"]) for row in rows))
    title = _told(rows, default)
    foot = f"{FOOT} Number: per cent of the frames that are wrong and not flagged."
    figure = sheet(WIDE_LINE_INCH * len(dimensions) + HEAD_INCH, title, foot)
    axes = figure.subplots()
    cells = _table(axes, rows, lambda row: row["dimension"])
    methods = list(dict.fromkeys(method for _, method in cells))
    for (dimension, method), cell in cells.items():
        share = _counted(cell, "wrong") / (_counted(cell, "frames") or 1.0)
        if share:
            at = methods.index(method), dimensions.index(str(dimension))
            text = "<1" if share < 0.01 else f"{100 * share:.0f}"
            axes.text(*at, text, ha="center", va="center", fontsize=SMALL_PT, color="white" if share > 0.5 else "black")
    axes.set_yticks(range(len(dimensions)), dimensions, fontsize=TEXT_PT)
    return figure


def _told(rows: Sequence[Row], default: str) -> str:
    """How many frames are wrong, compared with methods that answer as often: a method that flags all is never wrong."""
    wrong, flagged = (dict.fromkeys((str(row["method"]) for row in rows), 0) for _ in range(2))
    for row in rows:
        wrong[str(row["method"])] += round(_counted([row], "wrong"))
        flagged[str(row["method"])] += round(_counted([row], "flagged"))
    others = [count for name, count in wrong.items() if name != default and flagged[name] <= flagged[default]]
    own = f"Wrong without a flag: the daemon in {wrong[default]} frames"
    return f"{own}, every method with as few flags in at least {min(others)}" if others else own


def _conditions(rows: Sequence[Row], default: str) -> Figure:
    """Two columns, each with all methods, so that it is no taller than a screen. Dimensions with two axes have maps."""
    mapped = len({(row["dimension"], row["condition"], row["second"]) for row in rows if row["dimension"] in PLANES})
    rows = [row for row in rows if row["dimension"] not in PLANES]
    counted: dict[str, int] = {}
    for dimension, _ in dict.fromkeys((row["dimension"], row["condition"]) for row in rows):
        counted[str(dimension)] = counted.get(str(dimension), 0) + 1
    left, lines = [], 0
    for dimension, count in counted.items():
        if lines + count / 2 > sum(counted.values()) / 2:
            break
        left.append(dimension)
        lines += count
    wrong: dict[str, int] = {}
    for row in rows:
        wrong[str(row["method"])] = wrong.get(str(row["method"]), 0) + bool(_counted([row], "wrong"))
    own, others = wrong.pop(default), sorted(wrong.values())
    title = f"Of {sum(counted.values())} conditions the daemon is wrong in {own}, others in {others[0]} to {others[-1]}"
    foot = f"{FOOT} {mapped} more conditions have maps of their own: {' and '.join(PLANES)}." if mapped else FOOT
    figure = sheet(LINE_INCH * max(lines, sum(counted.values()) - lines) + HEAD_INCH, title, foot)
    for axes, first in zip(figure.subplots(1, 2), (True, False), strict=True):
        _condition_lines(axes, [row for row in rows if (row["dimension"] in left) == first])
    return figure


def _condition_lines(axes: Axes, rows: Sequence[Row]) -> None:
    conditions = list(dict.fromkeys((str(row["dimension"]), str(row["condition"])) for row in rows))
    _table(axes, rows, lambda row: (str(row["dimension"]), str(row["condition"])))
    for name in axes.get_xticklabels():
        name.set(rotation=90, ha="center", rotation_mode="default")
    begun: set[str] = set()
    names = []
    for line, (dimension, condition) in enumerate(conditions):
        names.append(condition if dimension in begun else f"{dimension}: {condition}")
        if dimension not in begun:
            axes.axhline(line - 0.5, color="black", linewidth=0.8)
        begun.add(dimension)
    axes.set_yticks(range(len(conditions)), names, fontsize=SMALL_PT)


def _maps(rows: Sequence[Row], dimension: str, default: str) -> Figure:
    """A map for each method that is wrong or flags something. The first free place names the others."""
    methods = list(dict.fromkeys(str(row["method"]) for row in rows))
    of = {method: [row for row in rows if row["method"] == method] for method in methods}
    shown = [method for method in methods if _counted(of[method], "wrong") or _counted(of[method], "flagged")]
    down, across, begins = PLANES[dimension]
    wrong = [method for method in shown if _counted(of[method], "wrong")]
    own = round(100 * _counted(of[default], "flagged") / _counted(of[default], "frames"))
    title = f"{begins}: {len(wrong)} of {len(methods)} methods are wrong; "
    title += f"the daemon {'too' if default in wrong else 'never is'}, and flags {own} %"
    right = [method for method in methods if method not in shown]
    lines = -(-(len(shown) + bool(right)) // MAPS_ACROSS)
    figure = sheet(1.55 * lines + 0.8, title, FOOT)
    grid = figure.subplots(lines, MAPS_ACROSS, squeeze=False, sharex=True, sharey=True)
    free = grid.flat[len(shown) :]
    for axes in free:
        axes.axis("off")
    if right:
        free[0].text(
            0.0, 1.0, "Right everywhere:\n" + "\n".join(right), transform=free[0].transAxes, va="top", fontsize=SMALL_PT
        )
    for axes, method in zip(grid.flat, shown, strict=False):
        _map(axes, method, of[method])
    grid[-1, 0].set_xlabel(across, fontsize=SMALL_PT)
    grid[0, 0].set_ylabel(down, fontsize=SMALL_PT)
    return figure


def _map(axes: Axes, method: str, rows: Sequence[Row]) -> None:
    across = list(dict.fromkeys(str(row["second"]) for row in rows))
    down = list(dict.fromkeys(str(row["condition"]) for row in rows))
    picture = np.ones((len(down), len(across), 3))
    for row in rows:
        picture[down.index(str(row["condition"])), across.index(str(row["second"]))] = _colour([row])
    axes.imshow(picture, aspect="auto", interpolation="nearest", rasterized=True)
    axes.set_title(method, fontsize=SMALL_PT)
    axes.set_xticks(range(len(across)), across, fontsize=7.0, rotation=45)
    axes.set_yticks(range(len(down)), down, fontsize=7.0)
