"""A chart of latency and processor time by number of pads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmfts_lab.bench.direct_labels import label_ends
from fmfts_lab.bench.latency_run import Run

# by number of pads: µs to the subscriber at p50 and at p99, and the share of a core
Point = tuple[float, float, float]


def draw(runs: dict[str, list[tuple[int, Run]]], file: Path) -> None:
    """Write an SVG or PNG, by the file's suffix. SystemExit if matplotlib is not installed."""
    points: dict[str, dict[int, Point]] = {}
    for name, each in runs.items():
        points[name] = {}
        for wanted in sorted({count for count, _ in each}):
            group = [run for count, run in each if count == wanted]
            p50, p99 = np.percentile(np.concatenate([run.to_subscriber_ns for run in group]), (50, 99)) / 1e3
            points[name][wanted] = float(p50), float(p99), float(np.mean([run.cpu_share for run in group]))
    draw_points(points, file)


def draw_points(points: dict[str, dict[int, Point]], file: Path) -> None:
    """As `draw`, of points by name ("echo", "daemon") and number of pads."""
    try:
        import matplotlib
    except ImportError:
        raise SystemExit("no chart: it needs matplotlib (pip install 'fmfts[plot]')") from None
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6))
    latency, processor = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.08, right=0.88, bottom=0.15, top=0.87, wspace=0.55)
    for name, colour in (("echo", "tab:grey"), ("daemon", "tab:blue")):
        counts = list(points[name])
        p50, p99, shares = np.array(list(points[name].values())).T
        latency.plot(counts, p50 / 1e3, marker="o", color=colour, label=f"{name}, median")
        latency.plot(counts, p99 / 1e3, "--", marker="o", color=colour, label=f"{name}, 99 %")
        processor.plot(counts, 100.0 * shares, marker="o", color=colour, label=name)
    latency.set(xscale="log", yscale="log", xlabel="pads at 220 Hz", ylabel="frame to subscriber, ms")
    processor.set(xscale="log", xlabel="pads at 220 Hz", ylabel="processor time, % of one core")
    for axes in (latency, processor):
        axes.grid(alpha=0.3)
        axes.set_xticks(counts, [str(count) for count in counts], minor=False)
        axes.xaxis.set_minor_formatter(lambda *_: "")
        label_ends(axes)
    latency.set_yticks((0.1, 0.2, 0.5, 1.0, 2.0, 5.0))
    latency.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    latency.yaxis.set_minor_formatter(lambda *_: "")
    most = max(counts)
    median_ms = max(each[0] for each in points["daemon"].values()) / 1e3
    share = points["daemon"][most][2]
    title = f"The median message arrives within {median_ms:.2f} ms; {most} pads take {share:.0%} of a core"
    figure.suptitle(title, fontsize="medium")
    figure.savefig(file)
