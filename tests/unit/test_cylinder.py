"""The exact cylinder, against an independent implementation and against its own far field."""

from __future__ import annotations

import magpylib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import elliprf, elliprj

from fmfts.pad import Magnet, Pad
from fmfts.pose import dipole_field
from fmfts_simulation.cylinder import cylinder_field, generalized_elliptic_integral


def poses_of_the_workspace(count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(7)
    position_m = np.column_stack([random.uniform(-3e-3, 3e-3, (count, 2)), random.uniform(6e-3, 14e-3, count)])
    axis = random.normal([0, 0, 1], [0.4, 0.4, 0.2], (count, 3))
    return position_m, axis / np.linalg.norm(axis, axis=1, keepdims=True)


def magpylib_field(point_m: np.ndarray, position_m: np.ndarray, axis: np.ndarray, magnet: Magnet) -> np.ndarray:
    turn = Rotation.from_euler("yz", [np.arccos(axis[2]), np.arctan2(axis[1], axis[0])])
    cylinder = magpylib.magnet.Cylinder(
        dimension=(magnet.diameter_m, magnet.length_m),
        polarization=(0.0, 0.0, magnet.remanence_t),
        position=position_m,
        orientation=turn,
    )
    return np.asarray(cylinder.getB(point_m))


@pytest.mark.parametrize("shape_m", [(2e-3, 2e-3), (3e-3, 1e-3), (1e-3, 4e-3)])
def test_field_agrees_with_magpylib_to_billionth_over_workspace(pad: Pad, shape_m: tuple[float, float]) -> None:
    magnet = Magnet(*shape_m, remanence_t=1.23)
    position_m, axis = poses_of_the_workspace(60)
    ours = cylinder_field(pad.sensors.position_m, position_m[:, None], axis[:, None], magnet)
    for pose in range(len(axis)):
        theirs = magpylib_field(pad.sensors.position_m, position_m[pose], axis[pose], magnet)
        assert np.abs(ours[pose] - theirs).max() < 1e-9 * np.linalg.norm(theirs, axis=1).min()


def test_field_on_the_axis_is_the_textbook_formula() -> None:
    magnet = Magnet(diameter_m=2e-3, length_m=2e-3, remanence_t=1.23)
    height_m = np.array([3e-3, 12e-3])
    point_m = np.column_stack([np.zeros((2, 2)), height_m])
    near, far = height_m - 1e-3, height_m + 1e-3
    expected = 1.23 / 2 * (far / np.hypot(far, 1e-3) - near / np.hypot(near, 1e-3))
    field = cylinder_field(point_m, np.zeros(3), np.array([0.0, 0.0, 1.0]), magnet)
    np.testing.assert_allclose(field[:, 2], expected, rtol=1e-12)
    np.testing.assert_array_equal(field[:, :2], 0.0)


def test_far_field_is_the_dipoles() -> None:
    """The next term of the expansion falls by (size / distance)²: 4e-6 at half a metre from 1 mm, times a few."""
    magnet = Magnet(diameter_m=2e-3, length_m=2e-3, remanence_t=1.23)
    point_m = np.random.default_rng(3).normal(0.0, 1.0, (20, 3))
    point_m *= 0.5 / np.linalg.norm(point_m, axis=1, keepdims=True)
    axis = np.array([0.36, 0.48, 0.8])
    exact = cylinder_field(point_m, np.zeros(3), axis, magnet)
    dipole = dipole_field(point_m, np.zeros(3), axis, magnet.strength_t_m3)
    difference = np.linalg.norm(exact - dipole, axis=1) / np.linalg.norm(dipole, axis=1)
    assert difference.max() < 1.2e-5


def test_every_sensor_may_see_the_magnet_at_another_pose(pad: Pad) -> None:
    position_m, axis = poses_of_the_workspace(4)
    together = cylinder_field(pad.sensors.position_m, position_m, axis, pad.magnet)
    for sensor in range(4):
        alone = cylinder_field(pad.sensors.position_m[sensor], position_m[sensor], axis[sensor], pad.magnet)
        np.testing.assert_allclose(together[sensor], alone, rtol=1e-12)


def test_elliptic_integral_agrees_with_carlson_forms() -> None:
    """cel(kc, p, 1, 1) = Π(1 − p | 1 − kc²) = R_F + (1 − p)/3·R_J (DLMF 19.25.2)."""
    random = np.random.default_rng(5)
    kc, p = random.uniform(0.05, 1.0, 200), random.uniform(0.05, 4.0, 200)
    expected = elliprf(0, kc**2, 1) + (1 - p) / 3 * elliprj(0, kc**2, 1, p)
    np.testing.assert_allclose(generalized_elliptic_integral(kc, p, kc**0, kc**0), expected, rtol=1e-11)
