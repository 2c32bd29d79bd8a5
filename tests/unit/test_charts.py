"""The charts of the kept results are those of their tables, name methods that exist, and are readable in a page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation

from fmfts_lab.study import charts, heat_map, labels, paper_chart, speed_chart
from fmfts_lab.study.contact_methods import contact_methods
from fmfts_lab.study.controller import CHART
from fmfts_lab.study.controller_methods import controller_methods
from fmfts_lab.study.harness import Row, read_table
from fmfts_lab.study.pose_methods import pose_methods
from fmfts_lab.study.stability import COMPARED, DAEMON
from fmfts_lab.study.style import WIDTH_INCH, sheet

RESULTS = Path(__file__).parents[2] / "lab/results"
SMALLEST_PX = 9.0  # pixels of a browser, in a column of 700 px
PAGE_PX = 700.0


def words_of(chart: Path) -> list[str]:
    """All text of an SVG, sorted."""
    return sorted(re.findall(r"<text[^>]*>([^<]*)</text>", chart.read_text()))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("charts")
    for table in RESULTS.glob("study-*.csv"):
        (folder / table.name).write_bytes(table.read_bytes())
    charts.main(["--folder", str(folder)])
    return folder


def test_kept_charts_are_those_of_the_kept_tables(drawn: Path) -> None:
    found = {chart.name: words_of(chart) for chart in drawn.glob("*.svg")}
    assert len(found) >= 9
    assert {chart.name: words_of(chart) for chart in RESULTS.glob("study-*.svg")} == found


def test_kept_tables_name_existing_methods() -> None:
    known = {
        "pose": {method.name for method in pose_methods()},
        "contact": {method.name for method in contact_methods()},
        CHART: {method.name for method in controller_methods()},
    }
    rows = read_table(RESULTS / "study-speed-accuracy.csv")
    told = [(str(row["chart"]), str(row["method"])) for row in rows if row["chart"] in known]
    assert [one for one in told if one[1] not in known[one[0]]] == []
    compared = {row["method"] for row in read_table(RESULTS / "study-stability.csv")}
    assert compared == {DAEMON, *COMPARED}


def test_daemon_is_compared_with_methods_that_answer_as_often() -> None:
    def row(method: str, wrong: int, flagged: int) -> Row:
        counted = {"frames": 100, "right": 100 - wrong - flagged, "wrong": wrong, "flagged": flagged}
        return {"dimension": "noise", "condition": "tenfold", "second": "", "method": method, **counted}

    silent, open_ones = row("silent", 1, 90), [row("first", 30, 10), row("second", 20, 20)]
    for others, told in (
        ([silent, *open_ones], "the daemon in 0 frames, every method with as few flags in at least 20"),
        ([silent], "the daemon in 0 frames"),
    ):
        _, figure = next(heat_map.figures([row(DAEMON, 0, 20), *others], DAEMON))
        assert figure.get_suptitle().replace("\n", " ") == f"Wrong without a flag: {told}"


def test_training_chart_names_its_lines_beside_them() -> None:
    curves = {"BP, field": (0.1, 0.01, 0.05), "RBF, field": (0.1, 0.02, 0.01)}  # the first rises again
    rows: list[Row] = [
        {"kind": "training", "case": case, "size": size, "trained_mse": error / 2, "left_out_mse": error}
        for case, errors in curves.items()
        for size, error in zip((1, 10, 100), errors, strict=True)
    ]
    figure = paper_chart.training(rows)
    assert figure.get_suptitle().replace("\n", " ").endswith("on others the error rises again in 1 of 2")
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    figure.draw(renderer)
    for axes in figure.axes:
        assert axes.get_legend() is None
        texts = [child for child in axes.get_children() if isinstance(child, Annotation)]
        assert [text.get_text() for text in texts] == ["trained on", "left out"]
        boxes = [text.get_window_extent(renderer) for text in texts]
        assert not boxes[0].overlaps(boxes[1])
        assert all(axes.get_window_extent(renderer).contains(box.x0, box.y0) for box in boxes)


def test_every_named_method_exists() -> None:
    assert set(speed_chart.POSES) <= {method.name for method in pose_methods()}
    assert set(speed_chart.CONTACTS) <= {method.name for method in contact_methods()}


def test_text_of_charts_is_readable_at_the_width_of_a_page(drawn: Path) -> None:
    for chart in drawn.glob("*.svg"):
        text = chart.read_text()
        (width,) = re.findall(r'<svg[^>]* width="([\d.]+)pt"', text)
        shown = min(1.0, PAGE_PX / (float(width) * 96.0 / 72.0))
        sizes = [float(size) for size in re.findall(r"font-size: ([\d.]+)px", text)]
        # A user unit of the SVG is a point, and a browser's pixel three quarters of one.
        assert min(sizes) * shown * 96.0 / 72.0 >= SMALLEST_PX, chart.name


def test_charts_bring_their_own_background(drawn: Path) -> None:
    """A page may be dark."""
    for chart in drawn.glob("*.svg"):
        patch = re.search(r'<g id="patch_1">\s*<path d="([^"]*)"\s*style="fill: (#\w+)', chart.read_text())
        assert patch is not None
        assert patch[2] == "#ffffff"


def written(points: Sequence[tuple[float, float]]) -> list[Annotation]:
    figure = sheet(5.0, "drill")
    axes = figure.subplots()
    axes.plot(*zip(*points, strict=True), "o")
    labels.write(axes, [labels.Label(f"method {number}", at, "black") for number, at in enumerate(points)], points)
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    assert figure.bbox.width == pytest.approx(WIDTH_INCH * figure.dpi)
    inside = axes.get_window_extent(renderer)
    texts = [child for child in axes.get_children() if isinstance(child, Annotation)]
    for text in texts:
        box = text.get_window_extent(renderer)
        assert inside.x0 <= box.x0
        assert box.x1 <= inside.x1
    return texts


def test_labels_of_near_points_cover_neither_each_other_nor_point() -> None:
    random = np.random.default_rng(1)
    points = [(float(x), float(y)) for x, y in random.normal(0.0, 0.02, (6, 2))]
    points += [(-1.0, -1.0), (1.0, 1.0)]
    texts = written(points)
    assert len(texts) == len(points)
    axes = texts[0].axes
    assert axes is not None
    renderer = FigureCanvasAgg(axes.figure).get_renderer()  # type: ignore[arg-type, no-untyped-call]
    boxes = [text.get_window_extent(renderer) for text in texts]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    for at in axes.transData.transform(np.array(points)):
        assert not any(box.contains(*at) for box in boxes)
