"""Labels lines of a chart where they end, so that nobody looks up a colour in a legend."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# share of the axes' height: labels that are closer overlap
APART = 0.075


def label_ends(axes: Axes) -> None:
    """Write each line's label right of the axes, at its last point and in its colour; near labels are moved apart."""
    axes.autoscale_view()  # only then are the limits known
    lines = [line for line in axes.get_lines() if not str(line.get_label()).startswith("_")]
    ends = [line.get_xydata()[-1] for line in lines]  # type: ignore[index]
    to_axes = axes.transData + axes.transAxes.inverted()
    heights = [float(to_axes.transform(end)[1]) for end in ends]
    lowest = -1.0
    for number in sorted(range(len(lines)), key=heights.__getitem__):
        lowest = max(heights[number], lowest + APART)
        label = axes.text(
            1.015, lowest, str(lines[number].get_label()), color=lines[number].get_color(), fontsize="small"
        )
        label.set(transform=axes.transAxes, verticalalignment="center", clip_on=False)
