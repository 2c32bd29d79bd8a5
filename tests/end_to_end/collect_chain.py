"""`make collect-chain`: baseline → collect → calibrate → evaluate on emulated machines, with no hand on it.

Collects the paper's plan with all imperfections of the bench, with each alone, and with none; calibrates from each and
from ideal data; and says what each costs on held-out presses. What is in the folder already is not made again: stopped
or killed, the same command goes on.
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
from fmfts.collect.plan import read_plan

GRAIN_S = 0.01
FIELDS = [f"b{sensor}{axis}_ut" for sensor in range(1, 5) for axis in "xyz"]
BACKLASH = {"backlash_mm": 0.05}
NOISE = {"noise_n": 0.005, "dropout": 0.02}
DELAY = {"delay_s": 0.02}
FIELD_NOISE = {"chip_noise_ut": 0.2}
NONE = {"backlash_mm": 0.0, "noise_n": 0.0, "dropout": 0.0, "delay_s": 0.0, "chip_noise_ut": 0.0}
# What the bench is like; the last two are what the collector would make of it if it were not told.
CASES = {
    "all": BACKLASH | NOISE | DELAY | FIELD_NOISE,
    "backlash": BACKLASH,
    "gauge noise": NOISE,
    "gauge delay": DELAY,
    "field noise": FIELD_NOISE,
    "none": {},
    "backlash left": BACKLASH | {"overshoot_mm": 0.0},
    "gauge delay left": DELAY | {"told_delay_s": 0.0},
}


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
    tables = {"ideal": ideal} | {case: collected(case, folder, options.plan, options.dialect) for case in CASES}
    judging.compare_responses(tables, held_out)
    both = {name: tables[name] for name in ("ideal", "all")}
    judging.run_the_verbs(both, held_out, folder / "all" / "config.toml")
    judging.compare_trainings(both, held_out, options.trainings, folder / "trainings.json")
    print(f"the chain took {(time.monotonic() - begun_s) / 60.0:.0f} minutes")


def collected(case: str, folder: Path, plan: str, dialect: str) -> Path:
    """The table of a case, as far as it is not there yet collected now; says how true it is."""
    own = folder / case.replace(" ", "-")
    own.mkdir(exist_ok=True)
    table, begun_s = own / "collected.csv", time.monotonic()
    with PressedBench(own, dialect, grain_s=GRAIN_S, **(NONE | CASES[case])) as bench:
        begun_ns = bench.clock.now_ns()
        if not (own / "state").exists():
            bench.record_baseline(bare=True)
            bench.record_baseline()
        facts = bench.collect(plan, table)
        bench_s = (bench.clock.now_ns() - begun_ns) * 1e-9
    print(
        f"{case}: {facts['collected']} of {facts['presses']} presses, {bench_s:.0f} s at the bench in "
        f"{time.monotonic() - begun_s:.0f} s; fields {off_by_ut(table):.3f} µT rms off the true ones of their labels",
        flush=True,
    )
    return table


def off_by_ut(table: Path) -> float:
    with table.open() as lines:
        rows = [row for row in csv.DictReader(lines) if row["press"] != "0"]
    pad = exact_pad()
    off_ut = [
        magnet_field_t(pad, float(row["x_mm"]) * 1e-3, float(row["y_mm"]) * 1e-3, float(row["force_n"])).ravel() * 1e6
        - [float(row[name]) for name in FIELDS]
        for row in rows
    ]
    return float(np.sqrt(np.mean(np.square(off_ut))))


def write_ideal(path: Path, plan: str) -> Path:
    """The very presses of a plan with the very fields, as `collect` writes them, the unloaded pad first."""
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
