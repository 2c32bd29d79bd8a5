"""Tables of the result pages say what commands found: of at least three seeds, and so that a command finds it again."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from fmfts_lab.bench import as_built, kept_figures, silicone, structure
from fmfts_lab.bench.kept_figures import FIGURES, RESULTS, TABLES, Table
from fmfts_lab.study import paper_table3

NAMES = {
    "table inversion": "table inversion",
    "shipped model": "shipped model",
    "shipped model, refined": "shipped model, `refine`",
}


@pytest.mark.parametrize("table", TABLES, ids=lambda table: f"{table.page} {table.figures}")
def test_table_has_the_kept_figures(table: Table) -> None:
    text = (RESULTS / table.page).read_text(encoding="utf-8")
    assert text == kept_figures.page(text, table), "python -m fmfts_lab.bench tables"


def test_presses_on_warm_pads_are_published_within_six_frames() -> None:
    rows = [row for seeds in kept_figures.kept("warm-presses") for row in seeds]
    assert all(row["begun"] <= row["published"] for row in rows)
    assert all(row["late_frames"] <= (5 if row["kelvin"] else 0) for row in rows)


def test_pads_within_tolerances_are_seldom_wrong() -> None:
    """With two deviations, 93 to 98 % of the errors in nine of ten rows, and in nine of ten of their places and
    forces."""
    rows = kept_figures.kept("as-built")

    def share_of_rows(*names: str) -> float:
        means = [sum(one[name] for one in seeds) / len(seeds) for seeds in rows for name in names]
        return sum(0.93 <= one <= 0.98 for one in means) / len(means)

    assert share_of_rows("within_2_sd") >= 0.9
    assert share_of_rows("place_within_2_sd", "force_within_2_sd") >= 0.9
    wrong, frames = (sum(one[key] for seeds in rows for one in seeds) for key in ("wrong", "frames"))
    assert wrong < 1e-4 * frames


@pytest.mark.parametrize(
    ("figures", "row_with", "kinds"),
    [
        ("as-built", "as-built.md#are-deviations", ("+ turn", "+ turn + refine")),
        ("shipped", "| bare and rest baselines alone", ("bare + rest",)),
        ("shipped", "| after `--turn`; after", ("+ turn", "+ turn + refine")),
    ],
)
def test_readme_says_the_largest_errors_of_the_kept_seeds(figures: str, row_with: str, kinds: tuple[str, ...]) -> None:
    rows = {(seeds[0]["turning"], seeds[0]["kind"]): seeds for seeds in kept_figures.kept(figures)}
    largest = [
        f"{1e3 * max(one['place_error_m'] for one in rows[True, kind]):.2f} mm, "
        f"{max(one['force_error_n'] for one in rows[True, kind]):.2f} N"
        for kind in kinds
    ]
    text = (RESULTS.parents[1] / "README.md").read_text(encoding="utf-8")
    (row,) = [line for line in text.splitlines() if row_with in line]
    assert row.split("|")[2].strip().removesuffix(", and the deviations say so") == "; ".join(largest)


BUILT = {
    "seconds": 9.1,
    "rotations": [1.0],
    "gains": [0.005],
    "refine": False,
    "untouched": False,
    "robots": as_built.ROBOTS,
    "baselines": as_built.KINDS,
}
CAST = {"seconds": 14.0, "known": True, "before": False, "only": ["as the"], "frictions": [0.0]}
AGAIN: dict[str, tuple[Callable[[Namespace], None], dict[str, object], tuple[str, ...]]] = {
    "as-built": (
        as_built.run,
        BUILT | {"seconds": 3.3, "counted": "stated"},
        ("within_2_sd", "place_error_m", "force_error_n"),
    ),
    "shipped": (as_built.run, BUILT | {"counted": "shipped"}, ("place_error_m", "force_error_n")),
    "silicone": (
        silicone.run,
        {"seconds": 12.0, "only": ["none"], "turn": False},
        ("within_2_sd", "place_error_m", "force_error_n"),
    ),
    "tilt": (structure.run, CAST | {"bare_and_rest": False}, ("place_within_2_sd", "force_sd")),
    "tilt-bare": (structure.run, CAST | {"bare_and_rest": True}, ("place_within_2_sd", "force_sd")),
}


@pytest.mark.long
@pytest.mark.parametrize("figures", AGAIN)
def test_row_is_measured_the_same_with_its_seed(figures: str, tmp_path: Path) -> None:
    """The first row, with the first of its seeds: to a tenth, so that only what changes the answers of pads fails
    here."""
    run, options, names = AGAIN[figures]
    kept = kept_figures.kept(figures)[0][0]
    out = tmp_path / "again.json"
    run(Namespace(seed=kept["seed"], pads=kept["pads"], out=out, **options))
    found = msgspec.json.decode(out.read_bytes())[0]
    assert found["frames"] == kept["frames"]
    for name in names:
        assert found[name] == pytest.approx(kept[name], rel=0.1), name


def test_fewer_than_three_seeds_make_no_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for file in sorted(FIGURES.glob("as-built-*.json"))[:2]:
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.setattr(kept_figures, "FIGURES", tmp_path)
    with pytest.raises(ValueError, match="at least 3"):
        kept_figures.kept("as-built")


def paper_row(name: str) -> list[float]:
    """A row of Table 3 on the page: x, y and force, for both magnets."""
    text = (RESULTS / "paper.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if line.startswith(f"| {name} |"))
    return [float(number) for cell in row.split("|")[2:4] for number in cell.split()]


def test_page_of_the_paper_says_what_the_table_inversion_finds() -> None:
    sets = paper_table3.Sets.read()
    rows = list(paper_table3._own_rows(sets, "table inversion", paper_table3._table(sets.calibration)))
    for refine, name in ((False, "shipped model"), (True, "shipped model, refined")):
        rows += list(paper_table3._own_rows(sets, name, paper_table3._model(refine)))
    found: dict[str, list[float]] = {}
    for row in paper_table3.table(rows):
        numbers = [paper_table3._number(row, f"mae_{name}") for name in paper_table3.OUTPUTS]
        found.setdefault(NAMES[str(row["case"])], []).extend(numbers)
    for name, values in found.items():
        # The page has at most four decimals.
        assert paper_row(name) == pytest.approx(values, abs=6e-5 if "model" not in name or "refine" in name else 6e-4)


def test_page_of_the_paper_has_the_papers_own_figures() -> None:
    text = (RESULTS / "paper.md").read_text(encoding="utf-8")
    for case, name in paper_table3.PAPER_CASES.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| {case} |")).split("|")
        for remanence_t, cell in zip(paper_table3.REMANENCES_T, row[4:6], strict=True):
            theirs = paper_table3._paper()[name, remanence_t]
            printed = [float(number) for number in re.findall(r"[\d.]+", cell)]
            assert printed == pytest.approx([theirs[f"mae_{one}"] for one in paper_table3.OUTPUTS], rel=0.03)


def cells_of(page: Path, first: str) -> list[str]:
    """The cells of the page's only row that begins with this one, the others behind it."""
    rows = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith(f"| {first} |")]
    (row,) = rows
    return [cell.strip() for cell in row.split("|")[2:-1]]


def test_manual_says_how_well_a_newton_is_known_as_the_results_do() -> None:
    """A share of a force is a force for 1 N."""
    manual, weigh = RESULTS.parents[1] / "docs/calibration.md", RESULTS / "weigh.md"
    states = ("before weighing", "after one weight", "after one weight, `finger_mm` names the finger")
    measured = [cells_of(weigh, state)[3:5] for state in (*states, "after five presses")]
    own = cells_of(RESULTS / "transfer.md", "own calibration")[0]
    for row, shares in (
        ("off by, median", [off for off, _ in measured] + [own]),
        ("its deviation", [deviation for _, deviation in measured]),
    ):
        printed = [float(cell.removesuffix(" N")) for cell in cells_of(manual, row) if cell]
        assert printed == pytest.approx([float(share.removesuffix(" %")) / 100.0 for share in shares]), row
