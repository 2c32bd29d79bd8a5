"""Charts of the error with slower, quieter sensors, and of the time that batches save."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from fmfts_lab.study.harness import Row
from fmfts_lab.study.pareto import name_ticks, number


def draw(rows: Sequence[Row]) -> Figure:
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    rates, batches = figure.subplots(1, 2)
    shown = [row for row in rows if row["chart"] == "rate"]
    for averaging in dict.fromkeys(row["averaging"] for row in shown):
        line = [row for row in shown if row["averaging"] == averaging]
        points = [number(row, "rate_hz") for row in line], [number(row, "position_um") for row in line]
        rates.plot(*points, "o-", label=f"{averaging} averaged" if averaging != 1 else "none averaged")
    rates.set(xlabel="frames per second", ylabel="rms error of the newest position (µm)", ylim=(0.0, None))
    rates.set_xticks(sorted({number(row, "rate_hz") for row in shown}))
    rates.legend(fontsize=8)
    rates.set_title("a magnet pressed for half a second, looked at at any moment", fontsize=9)
    shown = [row for row in rows if row["chart"] == "batch"]
    for method in dict.fromkeys(str(row["method"]) for row in shown):
        line = [row for row in shown if row["method"] == method]
        batches.plot(
            [str(row["batch"]) for row in line], [number(row, "median_us") for row in line], "o-", label=method
        )
    batches.set(yscale="log", xlabel="frames in a call", ylabel="processor time per frame (µs)")
    name_ticks(batches.yaxis)
    batches.set_title("one call for many frames", fontsize=9)
    batches.legend(fontsize=8)
    return figure
