"""What a controller acts on, as a chart and as a table: from the rows of `controller`, pooled over the pads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts.pad import Array
from fmfts_lab.study import pareto
from fmfts_lab.study.controller import CHART
from fmfts_lab.study.controller_methods import NOW
from fmfts_lab.study.harness import Facts, Row

ERRORS = ("publishing_n", "read_n", "publishing_mm", "read_mm", "noise_mn")
MEANS = ("answered", "age_ms", "late_ms")
TIMES = ("median_us", "p99_us", "of_todays_time")
QUIET, SWIFT, SLIDE = "hold", "tap in 50 ms", "slide 100 mm/s"
# What is drawn of which motion.
PANELS = (
    *((motion, "publishing_n") for motion in (QUIET, SWIFT, "release in 20 ms", "ramp 30 N/s", "stick-slip")),
    *((motion, "publishing_mm") for motion in (SWIFT, SLIDE)),
)
ROWS, ACROSS = 3, 3  # the panels, then that by noise, and the methods' names
LABELS = {"publishing_n": "error of force (N)", "publishing_mm": "error of place (mm)"}
TIME = "processor time of a frame, over today's"
CHANGING = ("tap", "release", "ramp")  # motions whose force changes fast
ABOUT = ("age_ms", "late_ms", "noise_mn")
TOLD_LATE = ("tap in 50 ms", "release in 20 ms", "ramp 30 N/s")


def pooled(rows: Sequence[Row]) -> list[Row]:
    """One row for each motion and method, over all pads: errors in squares, what else by its mean, times by medians."""
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
    """Of each method: what it costs, how old and how late it is, how noisy; and its errors by motion."""
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
    """At publishing, and when read."""
    errors = one["motions"][motion]
    return " / ".join(_text(errors[f"{when}_{unit}"], digits) for when in ("publishing", "read"))


def _text(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def draw(rows: Sequence[Row]) -> Figure:
    """A mark for each method: of each motion its error by its time; and its error in a tap by its noise."""
    found = pooled(rows)
    figure = Figure(figsize=(12.5, 10.0), layout="constrained")
    cells = figure.subplots(ROWS, ACROSS).ravel()
    for axes, (motion, error) in zip(cells, PANELS, strict=False):
        shown = _of_motion(found, motion)
        pareto.draw(axes, shown, error, NOW, cost="of_todays_time", most=None)
        _read(axes, shown, error, "of_todays_time")
        pareto.name_ticks(axes.xaxis)
        axes.set_xlabel(TIME, fontsize=9)
        axes.set_ylabel(LABELS[error], fontsize=9)
        axes.set_title(motion, fontsize=9)
    axes = cells[len(PANELS)]
    noise = {row["method"]: row["noise_mn"] for row in _of_motion(found, QUIET)}
    swift = [row | {"noise_mn": noise[row["method"]]} for row in _of_motion(found, SWIFT)]
    pareto.draw(axes, swift, "publishing_n", NOW, cost="noise_mn", most=None)
    pareto.name_ticks(axes.xaxis)
    axes.set_xlabel("noise of the force while held (mN)", fontsize=9)
    axes.set_ylabel(LABELS["publishing_n"], fontsize=9)
    axes.set_title(f"{SWIFT}, by noise", fontsize=9)
    pareto.name_methods(cells[-1], swift, NOW, share=1.0 / ROWS)
    title = "What a controller acts on: error (rms) when a message is published, and a line to that when it is read"
    figure.suptitle(title, fontsize=10)
    return figure


def _of_motion(found: Sequence[Row], motion: str) -> list[Row]:
    return [row for row in found if row["scene"] == motion]


def _read(axes: Axes, shown: Sequence[Row], error: str, cost: str) -> None:
    """A line from each mark to the error when a controller reads it."""
    for row in shown:
        at, read = pareto.number(row, cost), pareto.number(row, error.replace("publishing", "read"))
        axes.plot([at, at], [pareto.number(row, error), read], color="0.5", linewidth=0.8, zorder=2)
        axes.plot(at, read, "_", color="0.5", markersize=6, zorder=2)
