"""Compares the shipped table, and Maxwell–Betti reciprocity, with presses that finite elements solved one by one.

python -m fmfts_lab.finite_elements.check_table
"""

from __future__ import annotations

import sys

import numpy as np

from fmfts.pad import Array
from fmfts_lab.finite_elements.reciprocity import Influence
from fmfts_lab.finite_elements.slab import Slab
from fmfts_simulation.mechanics import Mechanics
from fmfts_simulation.solved_table import PRESSED_PATH, RESPONSE, SI, normal_mechanics, read_solved, standard_mechanics

FORCES_N = (0.3, 0.8, 2.0)
CENTRAL_MM = 1.0  # nearer to the centre the tilt is almost zero, so its relative error means nothing


def errors(mechanics: Mechanics, rows: Array) -> Array:
    """(K, 5) table minus finite elements, displacement in m and axis, for rows of `read_solved`."""
    found = mechanics.response(*(rows[:, :2] * 1e-3).T, *rows[:, 2:5].T)
    return np.asarray(found - rows[:, RESPONSE] * SI, dtype=np.float64)


def main() -> int:
    table = standard_mechanics()
    for name in ("test_normal", "test_shear"):
        rows = read_solved(PRESSED_PATH.with_name(f"{name}.csv"))
        way, tilt, tilt_error = _shares(errors(table, rows), rows)
        outer = np.hypot(rows[:, 0], rows[:, 1]) > CENTRAL_MM
        print(
            f"{name}: {len(rows)} presses; way {_rms(way):.3%} rms, {way.max():.3%} largest; "
            f"tilt {tilt[outer].max():.2%}, {tilt_error[outer].max() * 1e3:.2f} mrad largest; "
            f"nearer than {CENTRAL_MM:g} mm {tilt_error[~outer].max(initial=0.0) * 1e3:.2f} mrad"
        )
    rows = read_solved(PRESSED_PATH.with_name("test_shear.csv"))
    without = np.column_stack([rows[:, :3], np.zeros((len(rows), 2)), rows[:, RESPONSE]])
    added, left = errors(normal_mechanics(read_solved(PRESSED_PATH)), without), errors(table, rows)
    for part, name in ((slice(0, 3), "way"), (slice(3, 5), "tilt")):
        print(f"of what shear adds: {name} {np.linalg.norm(left[:, part]) / np.linalg.norm(added[:, part]):.2%} rms")
    linear, pressed = Influence.of(Slab()).mechanics(), read_solved(PRESSED_PATH)
    for force_n in FORCES_N:
        rows = pressed[pressed[:, 2] == force_n]
        print(f"reciprocity at {force_n:g} N: way off by at most {_shares(errors(linear, rows), rows)[0].max():.1%}")
    return 0


def _shares(error: Array, rows: Array) -> tuple[Array, Array, Array]:
    """(K,) relative errors of the displacement and of the tilt, and the absolute error of the tilt."""
    way_m, tilt = np.linalg.norm(rows[:, 5:8], axis=1) * 1e-6, np.linalg.norm(rows[:, 8:], axis=1)
    tilt_error = np.linalg.norm(error[:, 3:], axis=1)
    share = np.divide(tilt_error, tilt, out=np.zeros_like(tilt), where=tilt > 0.0)
    return np.linalg.norm(error[:, :3], axis=1) / way_m, share, tilt_error


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    sys.exit(main())
