"""`make collect-chain`: baseline → collect → calibrate → evaluate on emulated machines, with no hand on it.

Collects a plan, keeps what was really pressed beside it, and says what each imperfection of the bench costs: the same
calibration is done from what was collected, from the same with true places, with true forces, with noise-free fields,
and from ideal data.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from end_to_end.collecting_bench import PressedBench
from fmfts.collect.plan import read_plan

MACHINE_SPEED = 10.0
CALIBRATION = ("--hidden", "16", "--presses", "6000")  # what only has to compare need not be the best
BACKLASH_MM = 0.05
FIELDS = [f"b{sensor}{axis}_ut" for sensor in range(1, 5) for axis in "xyz"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plan", default="simulation")
    parser.add_argument("--dialect", default="marlin", choices=("marlin", "grbl"))
    parser.add_argument("--out", type=Path, help="keep the tables in this folder")
    options = parser.parse_args()
    folder = options.out or Path(tempfile.mkdtemp(prefix="fmfts-collect-"))
    with PressedBench(folder, options.dialect, speed=MACHINE_SPEED, backlash_mm=BACKLASH_MM, silence_ms=100.0) as bench:
        print(f"bench: {options.dialect}, machine {MACHINE_SPEED:g} times as fast as its feeds; tables in {folder}")
        bench.mounted = False
        time.sleep(0.1)  # until the board has heard of it
        carry_out(bench, "baseline", "--bare")
        bench.mounted = True
        time.sleep(0.1)
        carry_out(bench, "baseline", "--rest")
        collect(bench, options.plan, folder / "collected.csv")
        truth = np.array(bench.truth)
        variants(bench, folder, truth)
        judge(bench, folder)
    return 0


def carry_out(bench: PressedBench, *arguments: str | Path) -> str:
    done = bench.command(*arguments, timeout_s=7200.0)
    if done.returncode:
        raise SystemExit(f"{arguments[0]}: {done.stderr}")
    return done.stdout


def collect(bench: PressedBench, plan: str, output: Path) -> None:
    """To its end; a busy computer may make a device fall silent, and then the work is gone on with."""
    begun_s, stops = time.monotonic(), []
    for _ in range(20):
        done = bench.command("collect", plan, "-o", output, timeout_s=7200.0)
        if done.returncode == 0:
            break
        stops.append(done.stderr.strip().splitlines()[-1])
    else:
        raise SystemExit("\n".join(stops))
    print(
        f"collected in {time.monotonic() - begun_s:.0f} s; stopped and gone on with {len(stops)} times",
        *stops,
        sep="\n  ",
    )


def variants(bench: PressedBench, folder: Path, truth: np.ndarray) -> None:
    """What was collected with one imperfection after the other taken away."""
    with (folder / "collected.csv").open() as lines:
        table = list(csv.DictReader(lines))
    rows = [row for row in table if row["press"] != "0"]
    unloaded = [row for row in table if row["press"] == "0"]
    windows = {}
    for line in (folder / "collected.frames.jsonl").read_text().splitlines():
        record = json.loads(line)
        times = [frame["host_time_ns"] for frame in record["frames"]]
        windows[record["press"]] = (times[0], times[-1])
    pressed = np.array([true_press(truth, *windows[int(row["press"])]) for row in rows])
    label = np.array([[float(row[name]) for name in ("x_mm", "y_mm", "force_n")] for row in rows])
    delayed = np.array([true_press(truth, *(t - 20_000_000 for t in windows[int(row["press"])])) for row in rows])
    error = label - pressed
    print(f"labels: place off by {np.abs(error[:, :2]).mean():.4f} mm (largest {np.abs(error[:, :2]).max():.4f})")
    print(
        f"labels: force off by {np.std(error[:, 2]) * 1e3:.2f} mN rms (largest {np.abs(error[:, 2]).max() * 1e3:.2f})"
    )
    print(f"        20 ms of delay, were they not configured: {np.std(delayed[:, 2] - pressed[:, 2]) * 1e3:.3f} mN rms")
    field = np.array([bench.magnet_field_t(x * 1e-3, y * 1e-3, force).ravel() * 1e6 for x, y, force in pressed])
    measured = fields_of(rows)
    at_rest = fields_of(unloaded).mean(axis=0)
    true_rest = bench.magnet_field_t(0.0, 0.0, 0.0).ravel() * 1e6
    write(folder / "true-places.csv", np.column_stack([pressed[:, :2], label[:, 2]]), measured, at_rest)
    write(folder / "true-forces.csv", np.column_stack([label[:, :2], pressed[:, 2]]), measured, at_rest)
    write(folder / "true-fields.csv", label, field, true_rest)
    write(folder / "ideal.csv", pressed, field, true_rest)
    # Without the overshoot every second row of the plan is reached from above, and stands BACKLASH_MM off.
    beside = pressed.copy()
    beside[np.round(label[:, 1] / 2.0 + 7.0) % 2 == 1, 0] -= BACKLASH_MM
    write(folder / "backlash-left.csv", beside, field, true_rest)
    late = pressed.copy()
    late[:, 2] = delayed[:, 2]
    write(folder / "delay-left.csv", late, field, true_rest)


def held_out(bench: PressedBench, path: Path) -> None:
    """Ideal data at the places and forces of a test plan."""
    presses = read_plan("test-simulation").presses
    labels = np.array([[press.x_m * 1e3, press.y_m * 1e3, press.force_n] for press in presses])
    fields = np.array([bench.magnet_field_t(p.x_m, p.y_m, p.force_n).ravel() * 1e6 for p in presses])
    write(path, labels, fields, bench.magnet_field_t(0.0, 0.0, 0.0).ravel() * 1e6)


def judge(bench: PressedBench, folder: Path) -> None:
    """The same calibration from each table, and its errors on the held-out presses."""
    held_out(bench, folder / "held-out.csv")
    errors: dict[str, np.ndarray] = {}
    for name in ("ideal", "collected", "true-places", "true-forces", "true-fields", "backlash-left", "delay-left"):
        model = folder / f"{name}.onnx"
        carry_out(bench, "calibrate", folder / f"{name}.csv", "-o", model, *CALIBRATION)
        found = carry_out(bench, "evaluate", folder / "held-out.csv", "--model", model, "--json")
        whole = next(row for row in json.loads(found)["regions"] if row["region"] == "all")
        errors[name] = np.array([whole[f"mae_{what}"] for what in ("x_mm", "y_mm", "force_n")])
        ratio = errors[name] / errors["ideal"]
        x, y, force = errors[name]
        of_ideal = " ".join(f"{value:.3f}" for value in ratio)
        print(f"{name:14s} mean absolute error: x {x:.4f} mm, y {y:.4f} mm, {force:.5f} N; of ideal's: {of_ideal}")


def true_press(truth: np.ndarray, begun_ns: int, ended_ns: int) -> np.ndarray:
    """x, y (mm) and force, the mean over that time."""
    at = np.linspace(begun_ns, ended_ns, 20)
    index = np.searchsorted(truth[:, 0], at, side="right") - 1
    return truth[index, 1:].mean(axis=0)


def fields_of(rows: list[dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[name]) for name in FIELDS] for row in rows])


def write(path: Path, labels: np.ndarray, field_ut: np.ndarray, rest_ut: np.ndarray) -> None:
    """As `collect` writes it, the unloaded pad first."""
    with path.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(["x_mm", "y_mm", "force_n", *FIELDS])
        writer.writerow([0, 0, 0, *(f"{value:.5f}" for value in rest_ut)])
        for label, field in zip(labels, field_ut, strict=True):
            writer.writerow([f"{value:.5f}" for value in (*label, *field)])


if __name__ == "__main__":
    raise SystemExit(main())
