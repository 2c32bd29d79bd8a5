"""Draws the charts of kept results anew, without the run: `python -m fmfts_lab.study.charts` in the checkout.

lab/results keeps the table of the last whole run of each study here; STUDY.csv there is what `fmfts-daemon study STUDY`
writes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from fmfts_lab.study import heat_map, speed_chart, transfer, transfer_chart
from fmfts_lab.study.harness import Row, read_table, save
from fmfts_lab.study.stability import DAEMON

KEPT = Path(__file__).parents[2] / "results"
DRAWN: dict[str, Callable[[Sequence[Row]], Iterator[tuple[str, Figure]]]] = {
    "speed-accuracy": speed_chart.figures,
    "stability": lambda rows: heat_map.figures(rows, DAEMON),
    "transfer": lambda rows: iter([("", transfer_chart.draw(rows, transfer.METHODS))]),
}


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.study.charts", description="draw kept results anew")
    parser.add_argument("--folder", type=Path, default=KEPT, help="has study-NAME.csv, and gets study-NAME….svg")
    folder = parser.parse_args(words).folder
    for study, figures in DRAWN.items():
        rows = read_table(folder / f"study-{study}.csv")
        for suffix, figure in figures(rows):
            save(figure, folder / f"study-{study}{suffix}.svg")


if __name__ == "__main__":
    main()
