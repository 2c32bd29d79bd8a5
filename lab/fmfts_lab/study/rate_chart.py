"""Charts of the error with slower, quieter sensors, and of the time that batches save."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmfts_lab.study import labels
from fmfts_lab.study.harness import Row
from fmfts_lab.study.pareto import number
from fmfts_lab.study.style import COLOURS, SMALL_PT, TEXT_PT, name_ticks, sheet

Lines = dict[str, list[tuple[float, float]]]


def draw(rows: Sequence[Row]) -> Figure:
    figure = sheet(3.6, "Averaging costs more than it brings; batches save time, for files alone")
    rates, batches = figure.subplots(1, 2)
    of_rates: Lines = {}
    for row in (row for row in rows if row["chart"] == "rate"):
        name = "no averaging" if row["averaging"] == 1 else f"{row['averaging']} averaged"
        of_rates.setdefault(name, []).append((number(row, "rate_hz"), number(row, "position_um")))
    of_batches: Lines = {}
    for row in (row for row in rows if row["chart"] == "batch"):
        of_batches.setdefault(str(row["method"]), []).append((number(row, "batch"), number(row, "median_us")))
    rates.set(xlim=(5.0, 235.0), xticks=sorted({x for line in of_rates.values() for x, _ in line}))
    _lines(rates, of_rates)
    rates.set_ylim(0.0, None)
    rates.set_xlabel("frames per second", fontsize=TEXT_PT)
    rates.set_ylabel("rms error of the newest position (µm)", fontsize=TEXT_PT)
    batches.set(xscale="log", yscale="log", xlim=(0.1, 100.0))
    _lines(batches, of_batches)
    batches.set_xticks(sorted({x for line in of_batches.values() for x, _ in line}))
    batches.xaxis.set_major_formatter("{x:g}")
    batches.xaxis.minorticks_off()
    name_ticks(batches.yaxis)
    batches.set_xlabel("frames in a call", fontsize=TEXT_PT)
    batches.set_ylabel("processor time of a frame (µs)", fontsize=TEXT_PT)
    for axes, lines in ((rates, of_rates), (batches, of_batches)):
        colours = zip(lines.items(), COLOURS, strict=False)
        names = [labels.Label(name, line[0], colour) for (name, line), colour in colours]
        labels.write(axes, names, [point for line in lines.values() for point in _along(line)])
    return figure


def _along(line: Sequence[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Adds points between those of the line, so that no label covers the line."""
    for (x, y), (x_end, y_end) in pairwise(line):
        for share in np.linspace(0.0, 1.0, 30):
            yield x + share * (x_end - x), y + share * (y_end - y)


def _lines(axes: Axes, lines: Lines) -> None:
    for line, colour in zip(lines.values(), COLOURS, strict=False):
        axes.plot(*zip(*line, strict=True), "o-", color=colour, markersize=4.0)
    axes.tick_params(labelsize=SMALL_PT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.2)
