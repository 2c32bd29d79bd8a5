"""The errors that a baseline leaves, as patterns in the field: the scale for residuals that are no fault."""

from __future__ import annotations

import numpy as np
from mounted_world import FRAMES, NOISE_T, TOLERANCE, World
from pose_steps_in_c import lasting_deviation_t

from fmfts.baseline import Mounting
from fmfts.pad import Pad, rotation_from_vector
from fmfts.pose import FREE_FIELD, PoseEstimate, solve
from fmfts.pose.change import change_since
from fmfts.pose.dipole import dipole_derivatives
from fmfts.pose.state import tangent_basis

PADS = 60
# Of the baseline, which affects every change as well.
REST_NOISE_T = NOISE_T / np.sqrt(FRAMES)


def _pressed_and_turned(world: World, mounting: Mounting) -> tuple[np.ndarray, PoseEstimate]:
    """The field (N, 3) after a press of 1 N while the robot has turned, without noise, and what is solved from it."""
    turn = rotation_from_vector(world.random.normal(0.0, 1.0, 3))
    (state,) = world.pressed(np.array([2e-3]), np.array([-1e-3]), np.array([1.0]))
    measured = world.field(state) + world.sensed(turn @ world.earth_t - world.earth_t)
    field = mounting.magnet_field(measured)
    return field, solve(field, mounting.mounted(world.pad), mounting.rest, free=FREE_FIELD)


def _misfit(world: World, patterns: bool) -> float:
    """χ² of the residual where no pose hides it, over its four degrees of freedom."""
    mounting = world.baseline(TOLERANCE).mounting(world.pad)
    field, estimate = _pressed_and_turned(world, mounting)
    pad, state = mounting.mounted(world.pad), estimate.state
    strength = pad.magnet.strength_t_m3 * np.exp(state.log_moment)
    predicted, by_position, by_axis = dipole_derivatives(
        pad.sensors.position_m, state.position_m, state.axis, strength, pad.magnet.modelled_octupole_m2
    )
    unseen = np.concatenate([by_position, by_axis @ tangent_basis(state.axis), np.tile(np.eye(3), (4, 1, 1))], axis=2)
    parity = np.linalg.qr(unseen.reshape(12, 8) / np.abs(unseen).max(axis=(0, 1)), mode="complete")[0][:, 8:].T
    seen = parity @ (field - predicted - state.ambient_t).ravel()
    if patterns:
        errors = mounting.field_errors()
        assert errors is not None
        change = change_since(mounting.rest, state)
        spread = parity @ errors.at(change[:5], change[5:])
    else:
        spread = parity @ np.diag(lasting_deviation_t(mounting, pad, field, state.ambient_t).ravel())
    return float(seen @ np.linalg.solve(spread @ spread.T + REST_NOISE_T**2 * np.eye(4), seen)) / 4.0


def test_residuals_of_healthy_pads_match_the_baselines_uncertainty(pad: Pad) -> None:
    """240 degrees of freedom: the mean of χ² over them is 1 ± 0.09, and this is four of those."""
    ratios = [_misfit(World(pad, np.random.default_rng(seed)), patterns=True) for seed in range(PADS)]
    assert 0.64 < np.mean(ratios) < 1.36
    assert max(ratios) < 5.0


def test_deviations_of_single_axes_are_careful(pad: Pad) -> None:
    """They ignore correlations of the errors, and must not be too small for that."""
    ratios = [_misfit(World(pad, np.random.default_rng(seed)), patterns=False) for seed in range(PADS)]
    assert np.mean(ratios) < 1.0


def test_ambient_field_does_not_determine_sensor_places(pad: Pad) -> None:
    """Of a pressed pad on a robot that has turned: errors of gains and axes act on the whole change."""
    world = World(pad, np.random.default_rng(1))
    mounting = world.baseline(TOLERANCE).mounting(pad)
    turned = np.array([3e-5, -4e-5, 2e-5])
    ambient = pad.sensors.to_sensor(np.tile(turned, (4, 1)))
    change = ambient + world.random.normal(0.0, 1e-4, (4, 3))
    of_gains = mounting.sensitivity_deviation * change[:, None]
    expected = np.sqrt(
        (of_gains**2).sum(axis=2) + (mounting.place_deviation * (change - ambient)) ** 2 + mounting.systematic_t**2
    )
    found = lasting_deviation_t(mounting, pad, mounting.rest_field_t + change, turned)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert (mounting.place_deviation * np.abs(change - ambient)).max() > 0.1 * expected.max()
