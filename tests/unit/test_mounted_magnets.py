"""The magnets of a simulated pad with several move as the table of presses says, each from its own place."""

from __future__ import annotations

import numpy as np

from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.finger import Touch
from fmfts_simulation.mounted_magnets import MM, MountedMagnets

ONE, OTHER, NOTHING = Touch(3e-3, -4e-3, 0.8, 0.1, -0.2), Touch(-7e-3, 2e-3, 1.3), Touch(5e-3, 5e-3, 0.0)


def changes_of(inside: MountedMagnets, touch: Touch) -> np.ndarray:
    """The changes (M, 5) by one call of the table for each magnet, as the module's head says."""
    moved = []
    for number, (x_mm, y_mm) in enumerate(inside.off_mm.tolist()):
        pressed = inside.response.pressed(1e3 * touch.x_m - x_mm, 1e3 * touch.y_m - y_mm, touch.force_n)
        own = slice(5 * number, 5 * number + 5)
        moved.append(pressed.change[own] + pressed.by_shear[own] @ [touch.shear_x_n, touch.shear_y_n])
    return np.array(moved)


def test_magnets_move_by_the_table_under_changing_fingers() -> None:
    inside = MountedMagnets.of(array_config(seed=1), np.random.default_rng(1))
    assert np.abs(inside.off_mm).min() > 0.0
    moments = [[NOTHING], [ONE, OTHER], [ONE], [], [OTHER, NOTHING]]
    for fingers, moved in zip(moments, inside.moved(moments), strict=True):
        change = sum((changes_of(inside, touch) for touch in fingers if touch.force_n), np.zeros((4, 5))) * MM
        expected = inside.magnets.changed(change.ravel(), inside.frames)
        np.testing.assert_allclose(moved.position_m, expected.position_m, rtol=0, atol=1e-15)  # rounding of 10 mm
        np.testing.assert_allclose(moved.axis, expected.axis, rtol=0, atol=1e-15)
