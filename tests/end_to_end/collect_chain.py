"""`make collect-chain`: baseline → collect → calibrate → evaluate on emulated machines, without a person.

Collects the paper's plan with all imperfections of the bench, with each alone, and with none; calibrates from each and
from ideal data; and reports the cost of each on held-out presses. Existing files in the folder are not made again:
after a stop, the same command continues.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from end_to_end import collect_judging as judging
from end_to_end.collecting_bench import PressedBench, exact_pad, magnet_field_t
from fmfts_collect.errors import CollectError
from fmfts_collect.plan import read_plan

GRAIN_S = 0.005
FIELDS = [f"b{sensor}{axis}_ut" for sensor in range(1, 5) for axis in "xyz"]
BACKLASH = {"backlash_mm": 0.05}
NOISE = {"noise_n": 0.005, "dropout": 0.02}
DELAY = {"delay_s": 0.02}
PERFECT_MACHINES = {"backlash_mm": 0.0, "noise_n": 0.0, "dropout": 0.0, "delay_s": 0.0}
# Properties of the bench; its chips are always noisy, because without noise their steps would be an error of their own.
# The last two show the effect of a cause that the collector does not know.
CASES: dict[str, dict[str, float]] = {
    "all": BACKLASH | NOISE | DELAY,
    "all, 1 s a row": BACKLASH | NOISE | DELAY | {"average_s": 1.0},
    "field noise": {},
    "and backlash": BACKLASH,
    "and gauge noise": NOISE,
    "and gauge delay": DELAY,
    "and backlash left": BACKLASH | {"overshoot_mm": 0.0},
    "and delay left": DELAY | {"told_delay_s": 0.0},
}
UNHEEDED = ("and backlash left", "and delay left")  # a refusal is correct here


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plan", default="simulation")
    parser.add_argument("--dialect", default="marlin", choices=("marlin", "grbl"))
    parser.add_argument("--out", type=Path, help="the folder of all files (default: a new one)")
    parser.add_argument("--trainings", type=int, default=5, help="of the network, from each of two tables")
    options = parser.parse_args()
    folder = options.out or Path(tempfile.mkdtemp(prefix="fmfts-collect-"))
    folder.mkdir(parents=True, exist_ok=True)
    begun_s = time.monotonic()
    print(f"{options.dialect}; all files are in {folder}")
    ideal = write_ideal(folder / "ideal.csv", options.plan)
    held_out = write_ideal(folder / "held-out.csv", "test-simulation")
    tables = {"ideal": ideal}
    for case in CASES:
        try:
            tables[case] = collected(case, folder, options.plan, options.dialect)
        except CollectError as error:
            if case not in UNHEEDED:
                raise
            print(f"{case}: {error}", flush=True)
    judging.compare_responses(tables, held_out)
    both = {name: tables[name] for name in ("ideal", "all")}
    judging.run_the_verbs(both, held_out, folder / "all" / "config.toml")
    judging.compare_trainings(both, held_out, options.trainings, folder / "trainings.json")
    print(f"the chain took {(time.monotonic() - begun_s) / 60.0:.0f} minutes")


def collected(case: str, folder: Path, plan: str, dialect: str) -> Path:
    """Collects the missing part of a case's table; returns its accuracy."""
    own = folder / case.replace(",", "").replace(" ", "-")
    own.mkdir(exist_ok=True)
    table, truth, begun_s = own / "collected.csv", own / "how-true.txt", time.monotonic()
    if not truth.exists():
        with PressedBench(own, dialect, grain_s=GRAIN_S, **(PERFECT_MACHINES | CASES[case])) as bench:
            begun_ns = bench.clock.now_ns()
            if not (own / "state").exists():
                bench.record_baseline(bare=True)
                bench.record_baseline()
            facts = bench.collect(plan, table)
            bench_s = (bench.clock.now_ns() - begun_ns) * 1e-9
        took = f"{bench_s:.0f} s at the bench in {time.monotonic() - begun_s:.0f} s"
        said = f"{facts['collected']} of {facts['presses']} presses, {took}; {how_true(bench, table)}"
        truth.write_text(said)
    print(f"{case}: {truth.read_text()}", flush=True)
    return table


def how_true(bench: PressedBench, table: Path) -> str:
    """Labels beside the true presses, and fields beside the true ones, of the last run's rows."""
    with table.open() as lines:
        rows = [row for row in csv.DictReader(lines) if row["press"] != "0"]
    rows = [row for row in rows if row["recording"] == rows[-1]["recording"]]
    label = np.array([[float(row[name]) for name in ("x_mm", "y_mm", "force_n")] for row in rows])
    field_ut = np.array([[float(row[name]) for name in FIELDS] for row in rows])
    truth = np.array(bench.truth)
    pressed = np.array([pressed_between(truth, int(row["first_frame_ns"]), int(row["last_frame_ns"])) for row in rows])
    there_ut = np.array([bench.magnet_field_t(x * 1e-3, y * 1e-3, force).ravel() * 1e6 for x, y, force in pressed])
    x_mm, y_mm, force_n = np.sqrt(np.mean((label - pressed) ** 2, axis=0))
    field_off_ut = field_ut - there_ut
    scatter_ut, common_ut = field_off_ut.std(axis=0).mean(), np.abs(field_off_ut.mean(axis=0)).mean()
    return (
        f"labels are {x_mm:.4f} mm, {y_mm:.4f} mm and {force_n * 1e3:.2f} mN rms off what was pressed, fields "
        f"{scatter_ut:.3f} µT from row to row and {common_ut:.3f} µT in common"
    )


def pressed_between(truth: np.ndarray, begun_ns: int, ended_ns: int) -> np.ndarray:
    """x, y (mm) and force: the mean over that time."""
    index = np.searchsorted(truth[:, 0], np.linspace(begun_ns, ended_ns, 20), side="right") - 1
    mean: np.ndarray = truth[index, 1:].mean(axis=0)
    return mean


def write_ideal(path: Path, plan: str) -> Path:
    """Exactly a plan's presses with exactly their fields, as `collect` writes them, the unloaded pad first."""
    pad = exact_pad()
    with path.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(["x_mm", "y_mm", "force_n", *FIELDS])
        for x_m, y_m, force_n in [(0.0, 0.0, 0.0), *((p.x_m, p.y_m, p.force_n) for p in read_plan(plan).presses)]:
            field_ut = magnet_field_t(pad, x_m, y_m, force_n).ravel() * 1e6
            writer.writerow([f"{value:.5f}" for value in (x_m * 1e3, y_m * 1e3, force_n, *field_ut)])
    return path


if __name__ == "__main__":
    main()
