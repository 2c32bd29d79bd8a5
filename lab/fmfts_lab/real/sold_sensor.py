"""One magnet in an elastomer over four pixels of two axes: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor."""

from __future__ import annotations

import csv
from pathlib import Path

# Names of the sessions, their files in the folder of recordings, and a row that holds zeros.
SESSIONS = {"first": ("melexis/Calib.csv", -1), "second": ("melexis/Calibration_init.csv", 543)}
PIXELS = ("00", "01", "10", "11")
# A pixel ends somewhere above 33.1 mT, each at another field.
CLIPPED_MT = 33.0


def written_session(name: str, recorded: Path, folder: Path) -> Path:
    """A session's recording as `calibrate` reads it, written into `folder`: in µT, clipped values marked."""
    _, empty = SESSIONS[name]
    with recorded.open(newline="") as file:
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
