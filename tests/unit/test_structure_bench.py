"""What the laboratory says of pads that the shipped model does not know: `bench structure` on two of its rows."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest

from fmfts_lab.bench.cast_pads import CastMechanics, ramps
from fmfts_lab.bench.structure import CELLS, measured

OPTIONS = Namespace(seed=2, pads=1, seconds=6.0, bare_and_rest=False)


@pytest.mark.parametrize("name", ["stiff, 12 mm, 2°", "tilt 5°"])
def test_structure_tolerances_cover_pads_of_another_solver(name: str) -> None:
    (cell,) = [one for one in CELLS if one.name == name]
    before, counted = measured(cell, 0.0, OPTIONS, "nothing"), measured(cell, 0.0, OPTIONS, "tolerances")
    assert before["wrong"] > 0.05 * before["frames"]
    assert counted["wrong"] == 0
    assert counted["place_within_2_sd"] > 0.8
    assert counted["force_within_2_sd"] > 0.7
    assert counted["false_contact"] == before["false_contact"] == 0.0
    assert counted["felt"] > before["felt"] - 0.005, "what is not known of the scale makes no touch less certain"
    if "tilt" in name:
        assert abs(counted["along_tilt_mm"]) < 0.4 < 1.0 < before["along_tilt_mm"]


def test_tilt_turns_the_displacement_back_by_all_of_it() -> None:
    """Of the same pads, level and tilted by 5°: the places differ by 0.1 mm at most. Of each pad alone the mounting
    leaves a tilt of a degree unknown, and this difference is free of it."""
    level, tilted = (
        measured(replace(CELLS[0], tilt_deg=tilt_deg), 0.0, OPTIONS, "tilt")["along_tilt_mm"] for tilt_deg in (0.0, 5.0)
    )
    assert abs(tilted - level) < 0.1


def test_mirror_images_of_press_move_magnet_as_mirror_images() -> None:
    solved = ramps(4.0, 6.0, sheared=True)
    pad = CastMechanics(solved, 1.0)
    force_n = np.array([1.1])

    def moved(x: float, y: float, *shear: float) -> np.ndarray:
        loads = (np.array([share]) * force_n for share in (1.0, *shear))
        return pad.response(np.array([x]), np.array([y]), *loads)[0]

    (x, y), (along_x, along_y) = solved[0].place_m, solved[0].shear_share
    assert (along_x, along_y) != (0.0, 0.0)
    assert moved(x, y, along_x, along_y).any()
    assert not moved(x, y, along_x, -along_y).any(), "no such press was solved"
    np.testing.assert_allclose(moved(-x, y, -along_x, along_y), moved(x, y, along_x, along_y) * [-1, 1, 1, -1, 1])
    np.testing.assert_allclose(moved(y, x, along_y, along_x), moved(x, y, along_x, along_y)[[1, 0, 2, 4, 3]])


def test_softer_silicone_moves_the_magnet_as_more_force_does() -> None:
    solved = ramps(3.6, 6.0, sheared=False)
    place = [np.array([along]) for along in solved[0].place_m]
    soft, drawn = (CastMechanics(solved, modulus) for modulus in (0.5, 1.0))
    np.testing.assert_allclose(soft.response(*place, np.array([0.7])), drawn.response(*place, np.array([1.4])))
