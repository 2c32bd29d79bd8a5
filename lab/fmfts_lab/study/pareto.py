"""Speed against accuracy: a point for every method, the Pareto front, and names beside the methods that matter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes

from fmfts_lab.study import labels
from fmfts_lab.study.harness import Row
from fmfts_lab.study.style import COLOURS, OTHERS, SMALL_PT, name_ticks

COST = "median_us"
ROOM = 1.6  # how far each axis extends beyond the points, for the names
FOOT = (
    "Processor time: the median. Grey: variants of the named. Hollow: did not answer every frame. "
    "Broken line: no other method is both faster and more accurate."
)


def front(rows: Sequence[Row], cost: str, error: str) -> list[Row]:
    """The rows for which no other row is both faster and better; the fastest first."""
    best: list[Row] = []
    for row in sorted(rows, key=lambda one: (number(one, cost), number(one, error))):
        if not best or number(row, error) < number(best[-1], error):
            best.append(row)
    return best


def number(row: Row, name: str) -> float:
    value = row[name]
    assert isinstance(value, int | float)
    return float(value)


def draw(
    axes: Axes, rows: Sequence[Row], error: str, named: Mapping[str, str], default: str
) -> tuple[list[labels.Label], list[tuple[float, float]]]:
    """named: method → its name in the chart; the rest is grey. Returns what `labels.write` needs once all is drawn."""
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    points = [(number(row, COST), number(row, error)) for row in rows]
    names = []
    for row, at in zip(rows, points, strict=True):
        method = str(row["method"])
        colour = COLOURS[families.index(str(row["family"]))] if method in named else OTHERS
        whole, is_default = number(row, "answered") > 0.999, method == default
        axes.plot(
            *at, "*" if is_default else "o", color=colour, markersize=15 if is_default else 5.5,
            markerfacecolor=colour if whole else "white", zorder=4 if method in named else 3,
        )  # fmt: skip
        if method in named:
            names.append(labels.Label(named[method], at, colour, is_default))
    best = [(number(row, COST), number(row, error)) for row in front(rows, COST, error)]
    axes.step(*zip(*best, strict=True), where="post", color="0.4", linewidth=0.8, linestyle="--", zorder=1)
    axes.set(xscale="log", yscale="log")
    for axis, values in ((axes.set_xlim, [x for x, _ in points]), (axes.set_ylim, [y for _, y in points])):
        axis(min(values) / ROOM, max(values) * ROOM)
    axes.grid(alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
    name_ticks(axes.xaxis)
    name_ticks(axes.yaxis)
    axes.tick_params(labelsize=SMALL_PT)
    names.sort(key=lambda one: not one.bold)
    return names, points
