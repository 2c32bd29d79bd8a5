"""The finite elements of the pressed slab: what must hold whatever the mesh, and the independent calibration set."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import Press, Slab
from fmfts_lab.finite_elements.slab_mesh import SlabMesh

pytestmark = pytest.mark.needs(felupe="fem")


@cache
def coarse() -> PressedSlab:
    slab = PressedSlab(Slab(), element_m=2e-3)
    slab.rest()
    return slab


@pytest.mark.parametrize("place_mm", [(0.0, 0.0), (3.3, -7.1), (14.0, 14.0)])
def test_nodal_forces_add_up_to_what_a_load_cell_reads(place_mm: tuple[float, float]) -> None:
    """Force and the couple of a load about the patch's centre, to rounding."""
    x_mm, y_mm = place_mm
    slab = Slab()
    mesh = SlabMesh.of(slab, 1e-3)
    load = mesh.load(slab, Press(x_mm * 1e-3, y_mm * 1e-3, 1.5, 0.3, -0.2))
    np.testing.assert_allclose(load.sum(axis=0), [0.3, -0.2, -1.5], atol=1e-12)
    np.testing.assert_allclose(load[:, 2] @ mesh.points_mm[:, :2], [-1.5 * x_mm, -1.5 * y_mm], atol=1e-9)


def test_meshed_magnet_has_the_volume_of_the_cylinder() -> None:
    """Each circle is a polygon of its area; the sides of an 8-gon's prism are plane, so to rounding."""
    mesh = SlabMesh.of(Slab(), 1e-3)
    corners = mesh.points_mm[mesh.cells[mesh.magnet_cells]]
    floor = corners[:, :4, :2]
    following = np.roll(floor, -1, axis=1)
    area = np.abs(np.sum(floor[..., 0] * following[..., 1] - floor[..., 1] * following[..., 0], axis=1)) / 2.0
    height = corners[:, 4, 2] - corners[:, 0, 2]
    np.testing.assert_allclose(area @ height, np.pi * 2.0, rtol=1e-9)


def test_mirrored_press_moves_the_magnet_in_the_mirror() -> None:
    """x and y exchanged, shear too: 1e-5 of the displacement is what the iteration leaves."""
    slab = coarse()
    slab.rest()
    displacement_m, axis = slab.solve(Press(5e-3, 2e-3, 0.5, 0.1, -0.05))
    slab.rest()
    swapped_m, swapped_axis = slab.solve(Press(2e-3, 5e-3, 0.5, -0.05, 0.1))
    np.testing.assert_allclose(swapped_m[[1, 0, 2]], displacement_m, atol=1e-5 * np.linalg.norm(displacement_m))
    np.testing.assert_allclose(swapped_axis[[1, 0, 2]], axis, atol=1e-6)


def test_solved_press_is_independent_of_earlier_ones() -> None:
    slab = coarse()
    slab.rest()
    direct_m, _ = slab.solve(Press(4e-3, 0.0, 0.6))
    slab.solve(Press(4e-3, 0.0, 1.2, 0.3))
    returned_m, _ = slab.solve(Press(4e-3, 0.0, 0.6))
    np.testing.assert_allclose(returned_m, direct_m, atol=1e-5 * np.linalg.norm(direct_m))


def test_press_too_hard_for_the_slab_is_an_error() -> None:
    slab = PressedSlab(Slab(c10_pa=1e3, c01_pa=1e2), element_m=2e-3)
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        slab.solve(Press(0.0, 0.0, 50.0))


def test_magnet_outside_the_slab_is_refused() -> None:
    with pytest.raises(ValueError, match="does not lie inside a slab of 4 mm"):
        Slab(magnet_height_m=3.5e-3)
