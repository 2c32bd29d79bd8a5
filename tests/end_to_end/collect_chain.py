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
BACKLASH_MM = 0.05


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plan", default="simulation")
    parser.add_argument("--dialect", default="marlin", choices=("marlin", "grbl"))
    parser.add_argument("--out", type=Path, help="keep the tables in this folder")
    options = parser.parse_args()
    folder = options.out or Path(tempfile.mkdtemp(prefix="fmfts-collect-"))
    with PressedBench(folder, options.dialect, speed=MACHINE_SPEED, backlash_mm=BACKLASH_MM) as bench:
        print(f"bench: {options.dialect}, machine {MACHINE_SPEED:g} times as fast as its feeds; tables in {folder}")
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
        rows = list(csv.DictReader(lines))
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
    print(f"        of these 20 ms of delay, uncompensated: {np.std(delayed[:, 2] - pressed[:, 2]) * 1e3:.3f} mN rms")
    field = np.array([bench.magnet_field_t(*(x * 1e-3, y * 1e-3), force).ravel() * 1e6 for x, y, force in pressed])
    write(folder / "true-places.csv", rows, np.column_stack([pressed[:, :2], label[:, 2]]), None)
    write(folder / "true-forces.csv", rows, np.column_stack([label[:, :2], pressed[:, 2]]), None)
    write(folder / "true-fields.csv", rows, label, field)
    write(folder / "ideal.csv", rows, pressed, field)
    # Without the overshoot every second row of the plan is reached from above, and stands BACKLASH_MM off.
    from_above = np.append(False, np.diff(label[:, 0]) < 0.0) | (np.round(label[:, 1] / 2.0 + 7.0) % 2 == 1)
    beside = pressed.copy()
    beside[from_above, 0] -= BACKLASH_MM
    write(folder / "backlash-left.csv", rows, beside, field)


def held_out(bench: PressedBench, path: Path) -> None:
    """Ideal data at the places and forces of a test plan."""
    presses = read_plan("test-simulation").presses
    labels = np.array([[press.x_m * 1e3, press.y_m * 1e3, press.force_n] for press in presses])
    fields = np.array([bench.magnet_field_t(p.x_m, p.y_m, p.force_n).ravel() * 1e6 for p in presses])
    write(path, [{}] * len(presses), labels, fields)


def judge(bench: PressedBench, folder: Path) -> None:
    """The same calibration from each table, and its errors on the held-out presses."""
    held_out(bench, folder / "held-out.csv")
    errors: dict[str, np.ndarray] = {}
    for name in ("ideal", "collected", "true-places", "true-forces", "true-fields", "backlash-left"):
        model = folder / f"{name}.onnx"
        carry_out(bench, "calibrate", folder / f"{name}.csv", "-o", model, "--hidden", "24")
        found = carry_out(bench, "evaluate", folder / "held-out.csv", "--model", model, "--json")
        whole = next(row for row in json.loads(found)["regions"] if row["region"] == "all")
        errors[name] = np.array([whole[f"mae_{what}"] for what in ("x_mm", "y_mm", "force_n")])
        ratio = errors[name] / errors["ideal"]
        print(
            f"{name:14s} mean absolute error on 90 held-out presses: x {errors[name][0]:.4f} mm, y {errors[name][1]:.4f} "
            f"mm, force {errors[name][2]:.5f} N; of ideal's: {ratio[0]:.3f} {ratio[1]:.3f} {ratio[2]:.3f}"
        )


def true_press(truth: np.ndarray, begun_ns: int, ended_ns: int) -> np.ndarray:
    """x, y (mm) and force, the mean over that time."""
    at = np.linspace(begun_ns, ended_ns, 20)
    index = np.searchsorted(truth[:, 0], at, side="right") - 1
    return truth[index, 1:].mean(axis=0)


def write(path: Path, rows: list[dict[str, str]], labels: np.ndarray, field_ut: np.ndarray | None) -> None:
    fields = [f"b{sensor}{axis}_ut" for sensor in range(1, 5) for axis in "xyz"]
    with path.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(["x_mm", "y_mm", "force_n", *fields])
        for number, row in enumerate(rows):
            values = [row[name] for name in fields] if field_ut is None else [f"{v:.5f}" for v in field_ut[number]]
            writer.writerow([*(f"{value:.5f}" for value in labels[number]), *values])


if __name__ == "__main__":
    raise SystemExit(main())
