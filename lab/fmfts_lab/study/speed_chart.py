"""The charts of `study speed-accuracy`: one message each, and names beside the methods that matter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from matplotlib.figure import Figure

from fmfts_lab.study import controller_chart, labels, pareto, rate_chart
from fmfts_lab.study.contact_methods import DAEMON
from fmfts_lab.study.controller import CHART
from fmfts_lab.study.harness import Row
from fmfts_lab.study.pose_methods import DEFAULT
from fmfts_lab.study.style import TEXT_PT, sheet

TIME = "processor time of a frame (µs)"
# Method → its name in the charts.
POSES = {
    DEFAULT: "the daemon",
    "kernel, 5 unknowns": "pose only",
    "kernel, 6, from rest (the paper)": "pose and moment (the paper)",
    "kernel, 8, cylinder": "pose and ambient field, cylinder",
    "kernel, 9 unknowns": "pose, moment and ambient field",
    "leastsq, Jacobian": "SciPy leastsq",
    "least_squares trf": "SciPy least_squares",
    "extended Kalman": "extended Kalman filter",
    "unscented Kalman": "unscented Kalman filter",
    "look-up table": "look-up table",
    "network from field (20)": "neural network",
}
CONTACTS = {
    DAEMON: "the daemon",
    "the daemon, refine = true": "the daemon, refine = true",
    "shipped ONNX, refined": "the daemon's model from Python",
    "spline inversion": "spline through the table",
    "BP 20 of pose": "network of the pose, 20 neurons",
    "BP 12 × 12 of pose": "network of the pose, 12 × 12",
    "BP 20 of field": "network of the field, 20 neurons",
    "look-up table": "look-up table",
    "4 nearest neighbours": "4 nearest neighbours",
    "one step, field → contact": "one step from the field",
}
ROBOTS = {"drifting": "turns", "constant": "stands"}
SUFFIXES = {"drifting": "-pose", "constant": "-standing"}


def figures(rows: Sequence[Row]) -> Iterator[tuple[str, Figure]]:
    """Suffixes of files, and figures."""
    for scene, suffix in SUFFIXES.items():
        shown = _shown(rows, "pose", scene, "error_over_bound")
        if shown:
            yield suffix, _pose(shown, ROBOTS[scene])
    shown = _shown(rows, "contact", "as built", "mae_mm")
    if shown:
        yield "-contact", _contact(shown)
    if any(row["chart"] == "rate" for row in rows):
        yield "-rate", rate_chart.draw(rows)
    yield f"-{CHART}", controller_chart.draw(rows)


def _shown(rows: Sequence[Row], chart: str, scene: str, error: str) -> list[Row]:
    return [row for row in rows if row["chart"] == chart and row["scene"] == scene and row[error] is not None]


def _of(rows: Sequence[Row], method: str) -> Row:
    (row,) = (row for row in rows if row["method"] == method)
    return row


def _pose(rows: Sequence[Row], moves: str) -> Figure:
    own = _of(rows, DEFAULT)
    error, us = pareto.number(own, "error_over_bound"), pareto.number(own, "median_us")
    title = f"A robot that {moves}: the daemon's pose is {error:.2f} bounds off, after {us:.1f} µs"
    panels = [("error_over_bound", "rms error / Cramér–Rao bound")]
    return _drawn(sheet(5.0, title, pareto.FOOT), rows, panels, POSES, DEFAULT)


def _contact(rows: Sequence[Row]) -> Figure:
    own = _of(rows, DAEMON)
    mm, force_n, us = (pareto.number(own, name) for name in ("mae_mm", "mae_n", "median_us"))
    title = f"A built pad: the daemon's contact is {mm:.2f} mm and {1e3 * force_n:.0f} mN off, after {us:.1f} µs"
    panels = [("mae_mm", "mean error of place (mm)"), ("mae_n", "mean error of force (N)")]
    return _drawn(sheet(8.4, title, pareto.FOOT), rows, panels, CONTACTS, DAEMON)


def _drawn(
    figure: Figure, rows: Sequence[Row], panels: Sequence[tuple[str, str]], named: Mapping[str, str], default: str
) -> Figure:
    """panels: (column, its name) of each, one below the other."""
    below = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    written = []
    for axes, (error, name) in zip(below, panels, strict=True):
        axes.set_ylabel(name, fontsize=TEXT_PT)
        written.append(pareto.draw(axes, rows, error, named, default))
    below[-1].set_xlabel(TIME, fontsize=TEXT_PT)
    for axes, (names, points) in zip(below, written, strict=True):
        labels.write(axes, names, points)
    return figure
