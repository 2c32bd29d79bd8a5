"""Makes a calibration set from presses solved by finite elements: computes the fields at the standard pad's sensors.

    python -m fmfts_lab.calibration.solved_set SOLVED.csv … -o SET.csv [--mirrored] [--largest-force-n 2]
        [--remanence-t 1.23]

SOLVED.csv has x_mm, y_mm, force_n, shear_x_n, shear_y_n and the magnet's dx_um, dy_um, dz_um, axis_x, axis_y, as
`fmfts_lab.finite_elements.solved_presses` writes it. --mirrored adds all mirror images and quarter turns of each press
on the square pad. --largest-force-n leaves out presses with more force.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from fmfts.common.names import field_columns
from fmfts.contact.contract import SHEAR_OUTPUT_ORDER
from fmfts.pad import Array, Pad
from fmfts_calibrate.dataset import standard_pad
from fmfts_lab.calibration.simulated import magnet_fields
from fmfts_simulation.solved_table import mirrored, read_solved


def labelled(rows: Array, pad: Pad) -> Array:
    """(K, 5 + 3N) labels, and fields of the exact cylinder in µT."""
    tilt = rows[:, 8:]
    axis = np.column_stack([tilt, np.sqrt(1.0 - (tilt**2).sum(axis=1))])
    fields = magnet_fields(pad, rows[:, 5:8] * 1e-6, axis)
    return np.column_stack([rows[:, :5], fields.reshape(len(rows), -1) * 1e6])


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.calibration.solved_set")
    parser.add_argument("solved", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--mirrored", action="store_true")
    parser.add_argument("--largest-force-n", type=float, default=np.inf)
    parser.add_argument("--remanence-t", type=float, default=1.23)
    options = parser.parse_args(arguments)
    try:
        rows = np.concatenate([read_solved(path) for path in options.solved])
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 65
    rows = rows[rows[:, 2] <= options.largest_force_n]
    pad = standard_pad(options.remanence_t)
    table = labelled(mirrored(rows) if options.mirrored else rows, pad)
    header = ",".join([*SHEAR_OUTPUT_ORDER, *field_columns(len(pad.sensors))])
    np.savetxt(options.output, table, fmt="%.9g", delimiter=",", header=header, comments="")
    print(f"{options.output}: {len(table)} presses")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
