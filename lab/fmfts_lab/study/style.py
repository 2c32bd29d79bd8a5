"""How every chart looks: it is read at the width of a page, where no text is smaller than its own."""

from __future__ import annotations

import textwrap

import matplotlib
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

matplotlib.use("Agg")

WIDTH_INCH = 7.2  # 691 of a browser's pixels: a page does not shrink a chart of this width
TITLE_PT, TEXT_PT, SMALL_PT = 10.5, 9.0, 8.0
TITLE_LETTERS, FOOT_LETTERS = 80, 108  # in a line
OTHERS = "0.65"  # for points without a name
# Distinguishable by colour-blind readers: Okabe and Ito.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#b8860b", "#444444")


def sheet(height_inch: float, title: str, foot: str = "") -> Figure:
    """An empty figure as wide as a page, with one message as its title. foot: how to read it."""
    figure = Figure(figsize=(WIDTH_INCH, height_inch), layout="constrained")
    figure.suptitle("\n".join(textwrap.wrap(title, TITLE_LETTERS)), fontsize=TITLE_PT, weight="bold")
    if foot:
        wrapped = "\n".join(textwrap.wrap(foot, FOOT_LETTERS))
        figure.supxlabel(wrapped, fontsize=SMALL_PT, color="0.35", x=0.01, ha="left")
    return figure


def name_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers; at 2 and 5, too, because it may span less than a decade."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_minor_formatter("{x:g}")
    axis.set_tick_params(which="both", labelsize=SMALL_PT)
