"""python -m fmfts_lab.eflesh IN.csv -o OUT.csv: eFlesh's recordings as sets for `fmfts-daemon calibrate`.

IN has t_s, x_mm, y_mm, z_mm (of the probe's stage), gauge_g (a scale in grams, −1: no reading) and b1x_ut …, as made of
`characterization/datasets` of the public repository notvenky/eFlesh (MIT) by joining fields and stage by the nearest
time. Where many places are pressed the load is the depth below the highest row. Where one is, it is the gauge's, as
--load says, and rows at the highest 0.05 mm are of an untouched pad.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from fmfts.pad import Array
from fmfts_calibrate.field_table import write

NEWTON_PER_GRAM = 9.80665e-3
WITHDRAWN_MM = 0.05
ONE_PLACE_MM = 0.5  # a probe that travels less presses a single place


def columns(path: Path, load: str = "force_n", boards: int = 0) -> dict[str, list[str]]:
    """The columns of the set. boards: of five sensors each are taken; 0: all. ValueError for another file."""
    with path.open(newline="") as file:
        header, *lines = csv.reader(file)
    values = np.array(lines, dtype=np.float64)
    place = {name: number for number, name in enumerate(header)}
    if not {"x_mm", "y_mm", "z_mm", "b1x_ut"} <= set(place):
        raise ValueError(f"{path}: has no x_mm, y_mm, z_mm, b1x_ut: is it of eFlesh?")
    fields = [name for name in header if name.endswith("_ut")][: 15 * boards or None]
    height = values[:, place["z_mm"]]
    out: dict[str, list[str]] = {}
    travel = max(float(np.ptp(values[:, place[name]])) for name in ("x_mm", "y_mm"))
    if "gauge_g" in place and travel < ONE_PLACE_MM:
        gauge = values[:, place["gauge_g"]]
        rest = height > height.max() - WITHDRAWN_MM
        kept = rest | (gauge >= 0.0)
        out["rest"] = [str(int(one)) for one in rest[kept]]
        out[load] = _cells(np.where(rest, 0.0, gauge * NEWTON_PER_GRAM)[kept])
    else:
        kept = np.ones(len(values), dtype=np.bool_)
        middle = {
            name: (values[:, place[name]].min() + values[:, place[name]].max()) / 2.0 for name in ("x_mm", "y_mm")
        }
        out |= {name: _cells(values[:, place[name]] - middle[name]) for name in ("x_mm", "y_mm")}
        out["depth_mm"] = _cells(height.max() - height)
    out["recording"] = [path.stem] * int(kept.sum())
    return out | {name: [lines[row][place[name]] for row in np.flatnonzero(kept)] for name in fields}


def _cells(values: Array) -> list[str]:
    return [f"{value:.5g}" for value in values]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.eflesh", description=__doc__)
    parser.add_argument("data", type=Path, metavar="IN.csv")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.csv", required=True)
    parser.add_argument("--load", choices=("force_n", "shear_n"), default="force_n", help="what the gauge measured")
    parser.add_argument("--boards", type=int, default=0, help="boards of five sensors that are taken (all)")
    options = parser.parse_args()
    try:
        made = columns(options.data, options.load, options.boards)
        with options.output.open("w") as out:
            write(made, out)
    except (OSError, ValueError) as error:
        parser.exit(65, f"{error}\n")


if __name__ == "__main__":
    main()
