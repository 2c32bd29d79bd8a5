"""Makes the standard pad's calibration set: the paper's 675 presses, with noise-free fields of the exact cylinder.

    python -m fmfts_lab.calibration.standard_set tests/data/calibration_1.23T.csv

The force is that of a load cell under the probe (lab/README.md).
"""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path

import numpy as np

from fmfts.common.names import field_columns
from fmfts.contact.contract import OUTPUT_ORDER
from fmfts.pad import Array
from fmfts_calibrate.dataset import CalibrationSet, standard_pad
from fmfts_lab.calibration.simulated import pressed_fields

PLACES_MM = range(-14, 15, 2)
FORCE_N = (0.2827, 1.131, 1.9792)  # 10, 40 and 70 kPa on a patch of 6 mm


def rows() -> Array:
    """(675, 15): x, y in mm, force in N, fields in µT."""
    pad = standard_pad()
    press = np.array(list(product(PLACES_MM, PLACES_MM, FORCE_N)), dtype=np.float64)
    return np.column_stack([press, pressed_fields(pad, press).reshape(len(press), -1) * 1e6])


def standard_set() -> CalibrationSet:
    """The rows as a calibration set of the standard pad."""
    table, pad = rows(), standard_pad()
    field_t = table[:, 3:].reshape(len(table), len(pad.sensors), 3) * 1e-6
    return CalibrationSet(pad, table[:, :3], field_t, tuple(range(2, len(table) + 2)), "none", None)


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    header = ",".join([*OUTPUT_ORDER, *field_columns(len(standard_pad().sensors))])
    np.savetxt(Path(arguments[0]), rows(), fmt="%.6g", delimiter=",", header=header, comments="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
