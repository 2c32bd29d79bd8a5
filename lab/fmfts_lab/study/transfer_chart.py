"""The chart of `study transfer`: how wrong forces are on each pad, a line for each method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fmfts_lab.study.harness import Row
from fmfts_lab.study.pareto import number
from fmfts_lab.study.style import COLOURS, SMALL_PT, TEXT_PT, name_ticks, sheet

TITLE = "A pose takes a model to another magnet; a weight or five presses take it to other silicone"
FOOT = "Median error of a force on each pad, whose presses CalculiX has solved. The first is as the shipped model's."
APART = 1.12  # distance of two names beside the lines, as a factor of the error


def draw(rows: Sequence[Row], methods: Sequence[str]) -> Figure:
    figure = sheet(4.2, TITLE, FOOT)
    axes = figure.subplots()
    pads = list(dict.fromkeys(str(row["pad"]) for row in rows))
    ends: list[tuple[float, str, str]] = []
    for method, colour in zip(methods, COLOURS, strict=False):
        mine = {str(row["pad"]): 100.0 * number(row, "force_off") for row in rows if row["method"] == method}
        axes.plot(range(len(pads)), [mine[pad] for pad in pads], "o:", color=colour, markersize=5.0)
        ends.append((mine[pads[-1]], method, colour))
    axes.set(yscale="log", xlim=(-0.3, len(pads) + 0.9))
    name_ticks(axes.yaxis)
    axes.set_xticks(range(len(pads)), [pad.replace(", ", "\n") for pad in pads])
    axes.set_ylabel("error of the force (%)", fontsize=TEXT_PT)
    axes.tick_params(labelsize=SMALL_PT)
    axes.grid(axis="y", color="0.9")
    height = 0.0
    for end, method, colour in sorted(ends):
        height = max(end, height * APART)
        axes.annotate(
            method, (len(pads) - 0.9, height), color=colour, fontsize=SMALL_PT, va="center", annotation_clip=False
        )
        height *= float(np.sqrt(APART))
    return figure
