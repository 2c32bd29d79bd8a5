"""The stability study as pictures: red for wrong and unflagged, grey for flagged, white for right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts.pad import Array
from fmfts_lab.study.harness import Row

# Smaller shares get the colour of this one, so that a single wrong frame is visible.
FAINTEST = 0.25
# Dimension → what the rows and the columns of its map are.
PLANES = {
    "start error": ("the magnet jumps by", "its axis turns by"),
    "finger speed": ("a press lasts", "frames per second"),
}


def figures(rows: Sequence[Row], default: str) -> Iterator[tuple[str, Figure]]:
    """Suffixes and figures: every method in every condition, and maps of the two dimensions with two axes."""
    yield "", _overview([row for row in rows if row["dimension"] not in PLANES])
    yield "-maps", _maps([row for row in rows if row["dimension"] in PLANES], default)


def _colour(row: Row) -> Array:
    """(3,) RGB of a cell."""
    frames = float(row["frames"] or 1)
    wrong, flagged = float(row["wrong"] or 0) / frames, float(row["flagged"] or 0) / frames
    red = max(wrong, FAINTEST) if wrong else 0.0
    grey = 0.55 * flagged
    colour: Array = (1.0 - grey) * (1.0 - red) * np.ones(3) + red * np.array([0.85, 0.1, 0.1])
    return np.clip(colour, 0.0, 1.0)


def _overview(rows: Sequence[Row]) -> Figure:
    methods = list(dict.fromkeys(str(row["method"]) for row in rows))
    conditions = list(dict.fromkeys((str(row["dimension"]), str(row["condition"])) for row in rows))
    picture = np.ones((len(methods), len(conditions), 3))
    for row in rows:
        at = methods.index(str(row["method"])), conditions.index((str(row["dimension"]), str(row["condition"])))
        picture[at] = _colour(row)
    figure = Figure(figsize=(0.17 * len(conditions) + 3.2, 0.24 * len(methods) + 2.6), layout="constrained")
    axes = figure.subplots()
    axes.imshow(picture, aspect="auto", interpolation="nearest", rasterized=True)
    axes.set_yticks(range(len(methods)), methods, fontsize=7)
    axes.set_xticks(range(len(conditions)), [condition for _, condition in conditions], fontsize=6, rotation=90)
    dimensions = [dimension for dimension, _ in conditions]
    for dimension in dict.fromkeys(dimensions):
        first, count = dimensions.index(dimension), dimensions.count(dimension)
        axes.axvline(first - 0.5, color="black", linewidth=0.6)
        axes.text(first + count / 2 - 0.5, -0.7, dimension, fontsize=7, rotation=40, ha="left", va="bottom")
    axes.set_xlabel("red: wrong and not flagged; grey: flagged; white: right", fontsize=8)
    return figure


def _maps(rows: Sequence[Row], default: str) -> Figure:
    methods = list(dict.fromkeys(str(row["method"]) for row in rows))
    methods.sort(key=lambda name: name != default)
    columns = 4
    lines = -(-len(methods) // columns)
    figure = Figure(figsize=(13.0, 2.4 * lines * len(PLANES)), layout="constrained")
    for half, (dimension, names) in zip(
        figure.subfigures(len(PLANES), 1, squeeze=False)[:, 0], PLANES.items(), strict=True
    ):
        half.suptitle(f"{dimension}   (red: wrong and not flagged; grey: flagged; white: right)", fontsize=10)
        half.supylabel(names[0], fontsize=8)
        half.supxlabel(names[1], fontsize=8)
        grid = half.subplots(lines, columns, squeeze=False)
        for axes in grid.flat:
            axes.axis("off")
        for axes, method in zip(grid.flat, methods, strict=False):
            _map(axes, method, [row for row in rows if row["method"] == method and row["dimension"] == dimension])
    return figure


def _map(axes: Axes, method: str, rows: Sequence[Row]) -> None:
    across = list(dict.fromkeys(str(row["second"]) for row in rows))
    down = list(dict.fromkeys(str(row["condition"]) for row in rows))
    picture = np.ones((len(down), len(across), 3))
    for row in rows:
        picture[down.index(str(row["condition"])), across.index(str(row["second"]))] = _colour(row)
    axes.axis("on")
    axes.imshow(picture, aspect="auto", interpolation="nearest", rasterized=True)
    axes.set_title(method, fontsize=8)
    axes.set_xticks(range(len(across)), across, fontsize=6)
    axes.set_yticks(range(len(down)), down, fontsize=6)
