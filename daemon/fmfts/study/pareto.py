"""Speed against accuracy as a picture: every method a point, the front drawn, the daemon's own choice marked."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from fmfts.study.frame import Row

COLOURS = ("tab:blue", "tab:green", "tab:orange", "tab:red", "tab:purple", "tab:brown")


def front(rows: Sequence[Row], cost: str, error: str) -> list[Row]:
    """The rows that no other is both faster and better than, the fastest first."""
    best: list[Row] = []
    for row in sorted(rows, key=lambda one: (number(one, cost), number(one, error))):
        if not best or number(row, error) < number(best[-1], error):
            best.append(row)
    return best


def number(row: Row, name: str) -> float:
    value = row[name]
    assert isinstance(value, int | float)
    return float(value)


def draw(axes: Axes, rows: Sequence[Row], error: str, default: str) -> list[Row]:
    """Median time with a whisker to the 99th percentile; numbers name the methods, hollow ones left frames
    unanswered. What it returns is the front."""
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    best = front(rows, "median_us", error)
    for place, row in enumerate(rows, 1):
        x, y = number(row, "median_us"), number(row, error)
        colour = COLOURS[families.index(str(row["family"]))]
        axes.plot([x, number(row, "p99_us")], [y, y], color=colour, linewidth=0.8, alpha=0.6)
        whole = number(row, "answered") > 0.999
        is_default = row["method"] == default
        axes.plot(
            x, y, "*" if is_default else "o", color=colour, markersize=13 if is_default else 5,
            markerfacecolor=colour if whole else "white", markeredgecolor="black" if is_default else colour, zorder=3,
        )  # fmt: skip
        axes.annotate(str(place), (x, y), xytext=(4, 3), textcoords="offset points", fontsize=7)
    axes.step([number(row, "median_us") for row in best], [number(row, error) for row in best], where="post",
              color="black", linewidth=0.8, linestyle="--", zorder=1)  # fmt: skip
    axes.set(xscale="log", yscale="log")
    axes.grid(alpha=0.2)
    return best


def name_methods(axes: Axes, rows: Sequence[Row], default: str) -> None:
    """The numbers' meanings, in the families' colours."""
    families = list(dict.fromkeys(str(row["family"]) for row in rows))
    axes.axis("off")
    step = 1.0 / max(len(rows) + len(families), 1)
    height = 1.0
    for family in families:
        height -= step
        axes.text(0.0, height, family, fontsize=8, weight="bold", color=COLOURS[families.index(family)])
        for place, row in enumerate(rows, 1):
            if row["family"] == family:
                height -= step
                star = "  ★ the daemon's" if row["method"] == default else ""
                axes.text(0.04, height, f"{place}  {row['method']}{star}", fontsize=7)
