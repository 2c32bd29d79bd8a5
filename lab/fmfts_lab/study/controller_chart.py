"""What a controller acts on, as a chart and as a table: from the rows of `controller`, pooled over the pads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts.pad import Array
from fmfts_lab.study import pareto
from fmfts_lab.study.controller import CHART
from fmfts_lab.study.controller_methods import NOW, TODAY
from fmfts_lab.study.harness import Facts, Row
from fmfts_lab.study.style import COLOURS, OTHERS, SMALL_PT, TEXT_PT, name_ticks, sheet

ERRORS = ("publishing_n", "read_n", "publishing_mm", "read_mm", "noise_mn")
MEANS = ("answered", "age_ms", "late_ms")
TIMES = ("median_us", "p99_us", "of_todays_time")
QUIET, SWIFT, SLIDE = "hold", "tap in 50 ms", "slide 100 mm/s"
# Which quantity is drawn for which motion.
PANELS = (
    *((motion, "publishing_n") for motion in (SWIFT, "release in 20 ms", "ramp 30 N/s")),
    *((SLIDE, "publishing_mm"), ("stick-slip", "publishing_n"), (QUIET, "noise_mn")),
)
ACROSS = 3
READ = {"publishing_n": "read_n", "publishing_mm": "read_mm"}
LABELS = {"publishing_n": "force (N)", "publishing_mm": "place (mm)", "noise_mn": "noise of the force (mN)"}
TITLE = "What a controller acts on: in fast motions `now` is nearest to the truth"
FOOT = (
    "Dot: error (rms) when a message is published; its line ends at the error when a controller reads it. "
    "Hollow: did not answer every frame. ×: processor time of a frame, over that of today's fields."
)
CHANGING = ("tap", "release", "ramp")  # motions whose force changes fast
ABOUT = ("age_ms", "late_ms", "noise_mn")
TOLD_LATE = ("tap in 50 ms", "release in 20 ms", "ramp 30 N/s")


def pooled(rows: Sequence[Row]) -> list[Row]:
    """One row for each motion and method, over all pads: rms errors, medians of times, and means of the rest."""
    shown = [row for row in rows if row["chart"] == CHART]
    found: list[Row] = []
    for motion in dict.fromkeys(str(row["scene"]) for row in shown):
        for method in dict.fromkeys(str(row["method"]) for row in shown):
            own = [row for row in shown if (row["scene"], row["method"]) == (motion, method)]
            if own:
                found.append(_pooled(own))
    return found


def _pooled(own: Sequence[Row]) -> Row:
    row: Row = {name: own[0][name] for name in ("chart", "scene", "method", "family", "settings")}
    weights = [pareto.number(one, "frames") for one in own]
    row["frames"] = round(sum(weights))
    for name in (*ERRORS, *MEANS, *TIMES):
        known = [place for place, one in enumerate(own) if one[name] is not None]
        values = np.array([pareto.number(own[place], name) for place in known])
        row[name] = _together(name, values, np.array(weights)[known]) if known else None
    return row


def _together(name: str, values: Array, frames: Array) -> float:
    if name in TIMES:
        return round(float(np.median(values)), 3)
    if name in ERRORS:
        return round(float(np.sqrt(np.average(values**2, weights=frames))), 6)
    return round(float(np.average(values, weights=frames)), 5)


def facts(rows: Sequence[Row]) -> list[Facts]:
    """For each method: cost, age, delay, noise, and errors by motion."""
    found = pooled(rows)
    told = []
    for method in dict.fromkeys(str(row["method"]) for row in found):
        own = {str(row["scene"]): row for row in found if row["method"] == method}
        late = [
            pareto.number(row, "late_ms")
            for name, row in own.items()
            if name in TOLD_LATE and row["late_ms"] is not None
        ]
        one: Facts = {name: _median(own.values(), name) for name in ("of_todays_time", "median_us")}
        one["method"] = method
        one["age_ms"], one["noise_mn"] = _of(own, SWIFT, "age_ms"), _of(own, QUIET, "noise_mn")
        one["late_ms"] = round(float(np.mean(late)), 2) if late else None
        one["motions"] = {name: {error: row[error] for error in ERRORS[:4]} for name, row in own.items()}
        told.append(one)
    return told


def _median(rows: Iterable[Row], name: str) -> float:
    return round(float(np.median([pareto.number(row, name) for row in rows])), 2)


def _of(own: dict[str, Row], motion: str, name: str) -> float | None:
    row = own.get(motion)
    return None if row is None or row[name] is None else round(pareto.number(row, name), 2)


def table(told: Sequence[Facts]) -> str:
    """Three tables in Markdown: force where it changes fast, with what each method costs; force elsewhere; place."""
    motions = list(told[0]["motions"])
    swift = [motion for motion in motions if motion.startswith(CHANGING)]
    placed = [motion for motion in motions if any(one["motions"][motion]["publishing_mm"] is not None for one in told)]
    numbers = {
        one["method"]: (f"{one['of_todays_time']:.3g}", *(_text(one[name], 1) for name in ABOUT)) for one in told
    }
    parts = [
        _part(told, swift, "n", 3, ("time", "age", "late", "noise"), numbers),
        _part(told, [motion for motion in motions if motion not in swift], "n", 3),
        _part(told, placed, "mm", 2),
    ]
    return "\n".join(parts)


def _part(
    told: Sequence[Facts],
    motions: Sequence[str],
    unit: str,
    digits: int,
    head: Sequence[str] = (),
    numbers: Mapping[str, Sequence[str]] | None = None,
) -> str:
    lines = [_line(("method", *head, *motions)), _line(["---"] * (1 + len(head) + len(motions)))]
    for one in told:
        before = () if numbers is None else numbers[one["method"]]
        lines.append(_line((one["method"], *before, *(_pair(one, motion, unit, digits) for motion in motions))))
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _pair(one: Facts, motion: str, unit: str, digits: int) -> str:
    """The errors at publishing, and when read."""
    errors = one["motions"][motion]
    return " / ".join(_text(errors[f"{when}_{unit}"], digits) for when in ("publishing", "read"))


def _text(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def draw(rows: Sequence[Row]) -> Figure:
    """Draws the error of each method, by its name, when a message is published, and when a controller reads it."""
    found = pooled(rows)
    times = {one["method"]: one["of_todays_time"] for one in facts(rows)}
    figure = sheet(6.6, TITLE, FOOT)
    cells = figure.subplots(-(-len(PANELS) // ACROSS), ACROSS, sharey=True)
    for axes, (motion, error) in zip(cells.ravel(), PANELS, strict=True):
        for height, method in enumerate(reversed(times)):
            own = [row for row in found if (row["scene"], row["method"]) == (motion, method)]
            for row in own:
                _dot(axes, row, error, height)
        _dress(axes, f"{motion}\n{LABELS[error]}")
    cells[0, 0].set_yticks(range(len(times)), [f"{name}, {time:.3g}×" for name, time in reversed(times.items())])
    return figure


def _dot(axes: Axes, row: Row, error: str, height: int) -> None:
    """A line leads from the error at publishing to the error at a controller's reading, if both exist."""
    if row[error] is None:
        return
    at, is_now = pareto.number(row, error), row["method"] == NOW
    colour = COLOURS[0] if is_now else OTHERS if row["method"] != TODAY else "black"
    whole = pareto.number(row, "answered") > 0.999
    if error in READ:
        axes.plot([at, pareto.number(row, READ[error])], [height, height], "-", color=colour, linewidth=1.6)
    axes.plot(at, height, "o", color=colour, markersize=6.0, markerfacecolor=colour if whole else "white")


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=TEXT_PT)
    axes.set_xscale("log")
    name_ticks(axes.xaxis)
    axes.tick_params(axis="y", labelsize=SMALL_PT, length=0.0)
    axes.grid(alpha=0.2)
    axes.spines[["top", "right", "left"]].set_visible(False)
