"""Forces across two sessions of a sensor that was sold: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in an elastomer over four pixels of two axes each, and a load cell. The repository has no licence:
its files are not here; FMFTS_RECORDED names a folder with a folder melexis that has them (docs/results/real.md).
"""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from recorded_files import needs

from fmfts.calibrate.force_command import make_force_file

# Files, and a row that holds zeros.
RECORDED = {"first": ("melexis/Calib.csv", -1), "second": ("melexis/Calibration_init.csv", 543)}
PIXELS = ("00", "01", "10", "11")
# A pixel ends somewhere above 33.1 mT, each at another field.
CLIPPED_MT = 33.0


def _session(name: str, folder: Path) -> Path:
    """The recording as `calibrate` reads it: µT, and what is clipped marked."""
    source, empty = RECORDED[name]
    with needs(source).open(newline="") as file:
        rows = [row for number, row in enumerate(csv.DictReader(file)) if number != empty]
    path = folder / f"{name}.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        fields = [f"b{pixel}{axis}_ut" for pixel in range(1, 5) for axis in "xz"]
        writer.writerow(["session", "force_x_n", "force_y_n", "force_z_n", *fields])
        for row in rows:
            values = [float(row[f"B{axis}{pixel}"]) for pixel in PIXELS for axis in "xz"]
            cells = [f">{1e3 * CLIPPED_MT:g}" if one > CLIPPED_MT else f"{1e3 * one:.3f}" for one in values]
            writer.writerow([name, row["Fx"], row["Fy"], row["Fz"], *cells])
    return path


def test_forces_of_another_session(tmp_path: Path) -> None:
    """Each session by a model of the other alone. The deviations hold; what the errors miss of the aim: real.md."""
    sessions = [_session(name, tmp_path) for name in RECORDED]
    report = make_force_file(sessions, tmp_path / "both.force", None, None, lambda _: None)
    rows = {row["rows"]: row for row in report["routes"][0]["rows"]}
    assert rows["all"]["answered"] == 1909 + 660
    for session in ("session first", "session second"):
        assert 0.90 <= rows[session]["within_2"] <= 0.99
    assert rows["all"]["beyond_5"] <= 0.001
    for name, most in (("session first", (0.15, 0.10, 0.38)), ("session second", (0.12, 0.11, 0.40))):
        found = [rows[name][f"rms_{axis}_n"] for axis in "xyz"]
        assert all(one <= limit for one, limit in zip(found, most, strict=True)), found
    unclipped = [rows["no value clipped"][f"rms_{axis}_n"] for axis in "xyz"]
    assert unclipped == pytest.approx([0.121, 0.074, 0.284], abs=0.01)
