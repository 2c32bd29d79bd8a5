"""Charts of speed against accuracy: a point for every method, the Pareto front, and the daemon's choice marked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from fmfts_lab.study.harness import Row

COLOURS = ("tab:blue", "tab:green", "tab:orange", "tab:red", "tab:purple", "tab:brown")
LINE_INCH = 0.17  # height of a line in the list of methods


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
    axes: Axes, rows: Sequence[Row], error: str, default: str, cost: str = "median_us", most: str | None = "p99_us"
) -> list[Row]:
    """Draw `cost` (median times) with whiskers to `most` (the 99th percentile). Numbers stand for the methods; hollow
    points left frames unanswered. Returns the front."""
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    best = front(rows, cost, error)
    for row in rows:
        x, y = number(row, cost), number(row, error)
        colour = COLOURS[families.index(str(row["family"]))]
        if most is not None:
            axes.plot([x, number(row, most)], [y, y], color=colour, linewidth=0.8, alpha=0.6)
        whole = number(row, "answered") > 0.999
        is_default = row["method"] == default
        axes.plot(
            x, y, "*" if is_default else "o", color=colour, markersize=13 if is_default else 5,
            markerfacecolor=colour if whole else "white", markeredgecolor="black" if is_default else colour, zorder=3,
        )  # fmt: skip
    axes.step([number(row, cost) for row in best], [number(row, error) for row in best], where="post",
              color="black", linewidth=0.8, linestyle="--", zorder=1)  # fmt: skip
    axes.set(xscale="log", yscale="log")
    axes.grid(alpha=0.2)
    name_ticks(axes.yaxis)
    axes.xaxis.set_tick_params(labelsize=8)
    for places, at in _hiding_each_other(axes, [(number(row, cost), number(row, error)) for row in rows]):
        text = ", ".join(str(place) for place in places)
        white = {"facecolor": "white", "edgecolor": "none", "alpha": 0.5, "pad": 0.3}
        axes.annotate(text, at, (5, 4), textcoords="offset points", fontsize=7, zorder=4, bbox=white)
    return best


def name_ticks(axis: Axis) -> None:
    """Label the axis with plain numbers at 1, 2 and 5, because it may span less than a decade."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_minor_formatter("{x:g}")
    axis.set_tick_params(which="both", labelsize=8)


def _figure(axes: Axes) -> Figure:
    figure = axes.figure  # get_figure(root=True) came with Matplotlib 3.10
    assert isinstance(figure, Figure)
    return figure


def _hiding_each_other(
    axes: Axes, points: Sequence[tuple[float, float]]
) -> Iterator[tuple[list[int], tuple[float, float]]]:
    """Groups of points whose labels would overlap: their numbers, counted from one, and the place of the first."""
    inches = axes.transData.transform(points) / _figure(axes).dpi
    left = list(range(len(points)))
    while left:
        away = abs(inches[left] - inches[left[0]])
        near = [place for place, (right, up) in zip(left, away, strict=True) if right < 0.3 and up < 0.1]
        yield [place + 1 for place in near], points[left[0]]
        left = [place for place in left if place not in near]


def name_methods(axes: Axes, rows: Sequence[Row], default: str, share: float = 1.0) -> None:
    """Write the list of methods by number, in the colours of their families. share: of the figure's height."""
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    axes.axis("off")
    step = min(1.0 / max(len(rows) + len(families), 1), LINE_INCH / (share * _figure(axes).get_figheight()))
    height = 1.0
    for family in families:
        height -= step
        axes.text(0.0, height, family, fontsize=8, weight="bold", color=COLOURS[families.index(family)])
        for place, row in enumerate(rows, 1):
            if row["family"] == family:
                height -= step
                star = "  ★ the daemon's" if row["method"] == default else ""
                axes.text(0.04, height, f"{place}  {row['method']}{star}", fontsize=7)
