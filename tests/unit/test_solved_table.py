"""The table of solved presses, against presses that were solved one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmfts.pad import Array
from fmfts.simulate.mechanics import TABLE_PATH
from fmfts.simulate.solved_presses import normal_grid, normal_test, press_columns
from fmfts.simulate.solved_table import PRESSED_PATH, RESPONSE, SI, normal_mechanics, pressed_mechanics, read_solved

SIMULATE = Path(TABLE_PATH).parent


def errors(rows: Array) -> Array:
    """(K, 5) table less finite elements, in m and as numbers."""
    found = pressed_mechanics().response(rows[:, 0] * 1e-3, rows[:, 1] * 1e-3, rows[:, 2])
    return np.asarray(found - rows[:, RESPONSE] * SI, dtype=np.float64)


def test_table_is_within_three_thousandths_of_the_finite_elements_off_its_grid() -> None:
    """Of the way that the magnet goes; the tilt within a third of one frame's noise (2 mrad), and within 0.3 %
    of itself wherever it is not turning over near the centre."""
    rows = read_solved(SIMULATE / "test_normal.csv")
    assert len(rows) == 90
    error = np.linalg.norm(errors(rows)[:, :3], axis=1)
    assert (error < 0.003 * np.linalg.norm(rows[:, 5:8], axis=1) * 1e-6).all()
    tilt_error, tilt = np.linalg.norm(errors(rows)[:, 3:], axis=1), np.linalg.norm(rows[:, 8:], axis=1)
    assert tilt_error.max() < 0.6e-3
    outside = np.hypot(rows[:, 0], rows[:, 1]) > 5.0
    assert (tilt_error[outside] < 0.003 * tilt[outside]).all()


def test_solved_files_hold_the_presses_that_the_command_names() -> None:
    for name, presses in (("pressed.csv", normal_grid()), ("test_normal.csv", normal_test())):
        rows = read_solved(SIMULATE / name)
        np.testing.assert_allclose(rows[:, :5], [[float(v) for v in press_columns(press)] for press in presses])


def test_table_meets_its_own_presses() -> None:
    """To their rounding, 0.1 nm and 1e-7 rad."""
    error = errors(read_solved(PRESSED_PATH))
    assert np.abs(error[:, :3]).max() < 2e-10
    assert np.abs(error[:, 3:]).max() < 2e-7


def test_grid_with_a_press_missing_is_refused() -> None:
    with pytest.raises(ValueError, match="presses at 15 × 15 places and 6 forces"):
        normal_mechanics(read_solved(PRESSED_PATH)[:-1])
