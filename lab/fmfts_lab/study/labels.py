"""Labels beside the points of a chart, where they cover neither each other nor a point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

DIRECTIONS = 16
AWAY_PT = (8.0, 14.0, 22.0, 32.0, 44.0, 58.0)
LINE_FROM_PT = 12.0  # a label farther away than this gets a line to its point
MARK_PT = 4.0  # half of a point's size
# Cost of a label's place, in points of distance: for covering something, and for leaving the axes.
COVERS, LEAVES = 1000.0, 5000.0


class Label(NamedTuple):
    """Words for the point at x, y (data)."""

    words: str
    at: tuple[float, float]
    colour: str
    bold: bool = False


def write(axes: Axes, labels: Sequence[Label], points: Sequence[tuple[float, float]], size_pt: float = 9.0) -> None:
    """Write each label near its point, in their order: the first has the free choice. points: all that are drawn."""
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()  # only then is the layout final
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    pixels = figure.dpi / 72.0
    taken = [_around(at, MARK_PT * pixels) for at in axes.transData.transform(np.array(points))]
    inside = axes.get_window_extent(renderer)
    for label in labels:
        weight = "bold" if label.bold else "normal"
        text = axes.annotate(
            label.words, label.at, (0, 0), textcoords="offset points", fontsize=size_pt, color=label.colour,
            weight=weight, va="bottom", zorder=5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.2},
        )  # fmt: skip
        text.set_in_layout(False)
        whole = text.get_window_extent(renderer)
        point = axes.transData.transform(label.at)
        places = _places(point, whole.width, whole.height, pixels)
        away, box = min(places, key=lambda place: place[0] + _cost(place[1], taken, inside))
        text.xyann = (box.x0 - point[0]) / pixels, (box.y0 - point[1]) / pixels
        taken.append(box)
        if away > LINE_FROM_PT:
            _join(axes, label, box, point)


def _places(point: np.ndarray, width: float, height: float, pixels: float) -> Iterator[tuple[float, Bbox]]:
    """Distance in points, and the box of a label whose nearest edge is as far away as that."""
    for away in AWAY_PT:
        for angle in np.arange(DIRECTIONS) * 2.0 * np.pi / DIRECTIONS:
            toward = np.array([np.cos(angle), np.sin(angle)])
            middle = point + toward * (away * pixels + np.array([width, height]) / 2.0)
            yield away, Bbox.from_bounds(middle[0] - width / 2.0, middle[1] - height / 2.0, width, height)


def _cost(box: Bbox, taken: Sequence[Bbox], inside: Bbox) -> float:
    covered = sum(1 for other in taken if box.overlaps(other))
    fits = inside.x0 <= box.x0 and box.x1 <= inside.x1 and inside.y0 <= box.y0 and box.y1 <= inside.y1
    return COVERS * covered + (0.0 if fits else LEAVES)


def _around(point: np.ndarray, half: float) -> Bbox:
    return Bbox.from_bounds(point[0] - half, point[1] - half, 2.0 * half, 2.0 * half)


def _join(axes: Axes, label: Label, box: Bbox, point: np.ndarray) -> None:
    """A thin line from the point to the label's nearest edge."""
    nearest = np.clip(point, [box.x0, box.y0], [box.x1, box.y1])
    (x, y) = axes.transData.inverted().transform(nearest)
    axes.plot([label.at[0], x], [label.at[1], y], color=label.colour, linewidth=0.6, zorder=2, in_layout=False)
