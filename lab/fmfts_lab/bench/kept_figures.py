"""`python -m fmfts_lab.bench tables`: the tables of result pages, from figures that the benchmarks wrote with --out.

A row is measured with several seeds, and the table says the lowest and the highest of them. `lab/results/figures` keeps
what each seed gave, so that a page cannot say what no command found.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import msgspec

from fmfts_lab.bench import kept_rows
from fmfts_lab.bench.kept_rows import Rows

RESULTS = Path(__file__).parents[2] / "results"
FIGURES = RESULTS / "figures"
FEWEST_SEEDS = 3
# The table stands between such lines; the rest of the page is written by hand.
BEGIN, END = "<!-- {}, made by `python -m fmfts_lab.bench tables`: begin -->\n", "<!-- end -->\n"


class Table(NamedTuple):
    """figures: the files NAME-SEED.json of `lab/results/figures`."""

    page: str
    figures: str
    made: Callable[[Rows], str]


def kept(figures: str) -> Rows:
    """ValueError where too few seeds were measured, or not the same rows with each."""
    files = sorted(FIGURES.glob(f"{figures}-[0-9]*.json"))
    if len(files) < FEWEST_SEEDS:
        raise ValueError(f"{figures}: {len(files)} seeds in {FIGURES}, at least {FEWEST_SEEDS} are needed")
    seeds = [msgspec.json.decode(file.read_bytes()) for file in files]
    if len({len(rows) for rows in seeds}) != 1:
        raise ValueError(f"{figures}: not all seeds have the same rows")
    return list(zip(*seeds, strict=True))


TABLES = (
    Table("learned.md", "learned", kept_rows.learned),
    Table("as-built.md", "as-built", kept_rows.as_built),
    Table("as-built.md", "shipped", kept_rows.shipped),
    Table("silicone.md", "silicone", kept_rows.imperfect),
    Table("silicone.md", "warming", kept_rows.warming),
    Table("silicone.md", "warm-presses", kept_rows.warm_presses),
    Table("structure.md", "structure", kept_rows.structured),
    Table("structure.md", "tilt", kept_rows.tilted),
    Table("structure.md", "tilt-bare", kept_rows.tilted),
)


def page(text: str, table: Table) -> str:
    """The page with this table made anew. ValueError where it lacks its marks."""
    begin = BEGIN.format(table.figures)
    before, after = text[: text.index(begin)], text[text.index(END, text.index(begin)) :]
    return f"{before}{begin}{table.made(kept(table.figures))}{after}"


def run(options: Namespace) -> None:
    for table in TABLES:
        place = options.results / table.page
        place.write_text(page(place.read_text(encoding="utf-8"), table), encoding="utf-8")
