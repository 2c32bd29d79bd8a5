"""The simulated pad's mechanical response, against the calibration set that it stands for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.mechanics import recover_poses
from fmfts.simulate.cylinder import cylinder_field
from fmfts.simulate.mechanics import TABLE_PATH, Mechanics, standard_mechanics

CALIBRATION = Path(__file__).parents[1] / "data" / "calibration_1.23T.csv"


def test_calibration_set_is_reproduced_in_field() -> None:
    """To 3 nT: the table is rounded to 0.1 nm and 1e-7 rad (below 0.1 nT), the set to six digits (1 nT)."""
    calibration = read_calibration_set(CALIBRATION)
    displacement_m, axis = standard_mechanics().displacement(calibration.x_m, calibration.y_m, calibration.force_n)
    position_m = calibration.pad.rest_position_m + displacement_m
    field_t = cylinder_field(
        calibration.pad.sensors.position_m, position_m[:, None], axis[:, None], calibration.pad.magnet
    )
    assert len(field_t) == 675
    assert np.abs(field_t - calibration.field_t).max() < 3e-9


def test_table_that_ships_is_the_one_that_the_command_makes() -> None:
    calibration = read_calibration_set(CALIBRATION)
    recovered = recover_poses(calibration.field_t[::37], calibration.pad) * [1e6, 1e6, 1e6, 1.0, 1.0]
    table = np.loadtxt(TABLE_PATH, delimiter=",", skiprows=1)[::37, 3:]
    np.testing.assert_allclose(recovered[:, :3], table[:, :3], atol=2e-4)
    np.testing.assert_allclose(recovered[:, 3:], table[:, 3:], atol=2e-7)


def test_field_of_another_magnet_is_refused() -> None:
    calibration = read_calibration_set(CALIBRATION)
    with pytest.raises(ValueError, match="unexplained"):
        recover_poses(calibration.field_t[:1] * 1.02, calibration.pad)


def test_unloaded_pad_is_exactly_at_rest() -> None:
    place = np.linspace(-20e-3, 20e-3, 50)
    displacement_m, axis = standard_mechanics().displacement(place, -place, np.zeros(50))
    np.testing.assert_array_equal(displacement_m, 0.0)
    np.testing.assert_array_equal(axis, np.tile([0.0, 0.0, 1.0], (50, 1)))


def test_magnet_sinks_and_tilts_further_with_every_newton_up_to_four() -> None:
    random = np.random.default_rng(2)
    x_m, y_m = random.uniform(-14e-3, 14e-3, (2, 200))
    forces = np.linspace(0.0, 4.0, 41)
    response = [standard_mechanics().displacement(x_m, y_m, np.full(200, force)) for force in forces]
    depth = np.array([displacement_m[:, 2] for displacement_m, _ in response])
    tilt = np.array([np.hypot(axis[:, 0], axis[:, 1]) for _, axis in response])
    assert (np.diff(depth, axis=0) < 0.0).all()
    firm = np.hypot(x_m, y_m) > 1e-3  # at the centre there is no tilt to grow
    assert (np.diff(tilt[:, firm], axis=0) > 0.0).all()


def test_response_is_smooth_where_the_table_ends() -> None:
    """Just beyond the largest force and just before it, the compliance is the same: the tangent goes on."""
    force = standard_mechanics().largest_force_n + np.array([-2e-4, -1e-4, 0.0, 1e-4, 2e-4])
    displacement_m, _ = standard_mechanics().displacement(np.full(5, 4e-3), np.full(5, 2e-3), force)
    compliance = np.diff(displacement_m[:, 2]) / 1e-4
    np.testing.assert_allclose(compliance, compliance[0], rtol=1e-4)


def test_left_out_grid_points_are_met_as_the_docstring_says() -> None:
    table = np.loadtxt(TABLE_PATH, delimiter=",", skiprows=1)
    grid_m, force_n = np.unique(table[:, 0]) * 1e-3, np.unique(table[:, 2])
    response = table[:, 3:].reshape(15, 15, 3, 5) * [1e-6, 1e-6, 1e-6, 1.0, 1.0]
    coarse = Mechanics.from_table(grid_m[::2], force_n, response[::2, ::2])
    displacement_m, axis = coarse.displacement(table[:, 0] * 1e-3, table[:, 1] * 1e-3, table[:, 2])
    error = np.concatenate([displacement_m, axis[:, :2]], axis=1) - response.reshape(-1, 5)
    assert np.sqrt(np.mean(error[:, :3] ** 2, axis=0)).max() < 2.9e-6
    assert np.sqrt(np.mean(error[:, 3:] ** 2, axis=0)).max() < 0.18e-3
