"""The table of solved presses, against presses that were solved one by one."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts_lab.finite_elements.check_table import errors
from fmfts_lab.finite_elements.solved_presses import (
    SETS,
    centre_grid,
    normal_grid,
    normal_test,
    press_columns,
    shear_grid,
    shear_test,
)
from fmfts_simulation.solved_table import (
    CENTRE_PATH,
    PRESSED_PATH,
    RESPONSE,
    SI,
    normal_mechanics,
    read_solved,
    standard_mechanics,
)

SIMULATE = PRESSED_PATH.parent


def test_table_is_within_three_thousandths_of_finite_elements_off_its_grid() -> None:
    """Of the way that the magnet goes, and of its tilt; within a millimetre of the centre, where a tilt that comes to
    nothing is no measure, to 0.12 mrad (one frame's noise is 2 mrad)."""
    rows = read_solved(SIMULATE / "test_normal.csv")
    assert len(rows) == 90
    error = errors(standard_mechanics(), rows)
    assert (np.linalg.norm(error[:, :3], axis=1) < 0.003e-6 * np.linalg.norm(rows[:, 5:8], axis=1)).all()
    tilt_error, tilt = np.linalg.norm(error[:, 3:], axis=1), np.linalg.norm(rows[:, 8:], axis=1)
    central = np.hypot(rows[:, 0], rows[:, 1]) < 1.0
    assert (tilt_error < np.where(central, 0.12e-3, 0.003 * tilt)).all()


def test_sheared_presses_are_accurate_to_three_thousandths() -> None:
    """In any direction, up to half the normal force, within 8 mm: way and tilt."""
    rows = read_solved(SIMULATE / "test_shear.csv")
    assert len(rows) == 60
    error = errors(standard_mechanics(), rows)
    assert (np.linalg.norm(error[:, :3], axis=1) < 0.003e-6 * np.linalg.norm(rows[:, 5:8], axis=1)).all()
    assert (np.linalg.norm(error[:, 3:], axis=1) < 0.003 * np.linalg.norm(rows[:, 8:], axis=1)).all()


def test_table_is_valid_to_the_rim_and_for_double_friction() -> None:
    """Presses with shear up to 0.8 of their force, all over the pad; the table was made with 0.4."""
    rows = read_solved(SIMULATE / "test_friction.csv")
    assert len(rows) == 60
    error = errors(standard_mechanics(), rows)
    assert np.abs(error[:, :3]).max() < 0.6e-6  # a frame knows the height to 3.5 µm
    assert np.abs(error[:, 3:]).max() < 0.2e-3  # a frame knows the tilt to 3.5 mrad


def test_shear_moves_the_magnet_as_the_table_says() -> None:
    """Of that alone the table is right to 1 % rms: a hundredth of what would be lost without it."""
    rows = read_solved(SIMULATE / "test_shear.csv")
    normal = standard_mechanics().response(rows[:, 0] * 1e-3, rows[:, 1] * 1e-3, rows[:, 2])
    added = rows[:, RESPONSE] * SI - normal
    for part in (slice(0, 3), slice(3, 5)):
        assert np.linalg.norm(errors(standard_mechanics(), rows)[:, part]) < 0.01 * np.linalg.norm(added[:, part])


def test_solved_files_hold_the_presses_that_the_command_names() -> None:
    sets = {"pressed.csv": normal_grid(), "pressed_centre.csv": centre_grid(), "test_normal.csv": normal_test()}
    sets |= {"sheared.csv": shear_grid(), "test_shear.csv": shear_test()}
    sets |= {f"{name}.csv": SETS[name.replace("_", "-")]() for name in ("test_friction", "test_friction_3")}
    for name, presses in sets.items():
        rows = read_solved(SIMULATE / name)
        np.testing.assert_allclose(rows[:, :5], [[float(v) for v in press_columns(press)] for press in presses])


def test_table_meets_its_own_presses() -> None:
    """To their rounding, 0.1 nm and 1e-7 rad."""
    error = errors(standard_mechanics(), np.concatenate([read_solved(PRESSED_PATH), read_solved(CENTRE_PATH)]))
    assert np.abs(error[:, :3]).max() < 2e-10
    assert np.abs(error[:, 3:]).max() < 2e-7


def test_grid_with_a_press_missing_is_refused() -> None:
    with pytest.raises(ValueError, match="presses at 15 × 15 places and 6 forces"):
        normal_mechanics(read_solved(PRESSED_PATH)[:-1])
