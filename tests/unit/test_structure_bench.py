"""What the laboratory says of pads that the shipped model does not know: `bench structure` on two of its rows."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest

from fmfts_lab.bench.any_pad import Trial, drawn
from fmfts_lab.bench.cast_pads import CastMechanics, CastPad, ramps
from fmfts_lab.bench.structure import CELLS, Cell, measured
from fmfts_lab.bench.weigh import facts_of

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


def test_displacement_is_corrected_by_the_whole_tilt() -> None:
    """Of the same pads, level and tilted by 5°: the places differ by 0.1 mm at most. Of each pad alone the mounting
    leaves a tilt of a degree unknown, and this difference is free of it."""
    level, tilted = (
        measured(replace(CELLS[0], tilt_deg=tilt_deg), 0.0, OPTIONS, "tilt")["along_tilt_mm"] for tilt_deg in (0.0, 5.0)
    )
    assert abs(tilted - level) < 0.1


def test_mirror_images_of_press_move_magnet_as_mirror_images() -> None:
    solved = ramps(CastPad(4.0, 6.0), sheared=True)
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
    solved = ramps(CastPad(3.6, 6.0), sheared=False)
    place = [np.array([along]) for along in solved[0].place_m]
    soft, drawn = (CastMechanics(solved, modulus) for modulus in (0.5, 1.0))
    np.testing.assert_allclose(soft.response(*place, np.array([0.7])), drawn.response(*place, np.array([1.4])))


def moved_in_the_middle(cell: Cell, force_n: float) -> np.ndarray:
    solved = cell.ramps()
    place = [np.array([along]) for along in solved[0].place_m]
    return np.asarray(CastMechanics(solved, cell.modulus).response(*place, np.array([force_n]))[0])


def test_poissons_ratio_changes_a_press_as_calculix_solved_it() -> None:
    """The rows of cast_presses.csv for 0.6 N at (0.7, 0.4) mm: 4 mm thick with 0.47, 3.6 mm thick with both ratios."""
    softer, usual, stiffer = (moved_in_the_middle(Cell("", poisson=each), 0.6) for each in (0.47, 0.49, 0.4999))
    assert softer[2] == pytest.approx(-661.30e-6, rel=1e-4)
    assert usual[2] == pytest.approx(-639.88e-6, rel=1e-4)
    np.testing.assert_allclose((stiffer - usual) / (usual - softer), 0.495, rtol=1e-6)
    thin = moved_in_the_middle(Cell("", thickness_mm=3.6, poisson=0.47), 0.6)
    assert thin[2] / -822.14e-6 == pytest.approx(1.0356, abs=1e-4)


def test_poissons_effect_elsewhere_comes_from_the_drawn_pad() -> None:
    thick, drawn = (
        [Cell("", thickness_mm=thickness_mm, poisson=poisson).ramps()[-1].powers[0, 2] for poisson in (0.47, 0.49)]
        for thickness_mm in (4.4, 4.0)
    )
    assert thick[0] / thick[1] == pytest.approx(drawn[0] / drawn[1], abs=2e-3)


def test_any_pad_is_right_after_a_weight_and_after_five_presses() -> None:
    trial = Trial(3, Namespace(seconds=3.0, refine=False))
    assert trial.refused == []
    before, weighed, named, pressed = (facts_of([each]) for each in trial.found)
    assert before["wrong"] == weighed["wrong"] == named["wrong"] == pressed["wrong"] == 0
    assert before["force_off_median"] > 2.0 * max(named["force_off_median"], pressed["force_off_median"])


def test_any_pad_draws_the_whole_range() -> None:
    cells = [drawn(seed) for seed in range(1, 201)]
    assert min(cell.modulus for cell in cells) < 0.51 < 1.9 < max(cell.modulus for cell in cells)
    assert min(cell.poisson for cell in cells) < 0.472 < 0.499 < max(cell.poisson for cell in cells) < 0.4999
    assert {cell.thickness_mm for cell in cells} == {3.6, 4.0, 4.4}
    assert {cell.finger_mm for cell in cells} == {3.0, 6.0, 12.0}


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: cell.name)
def test_every_force_of_a_sheared_press_moves_the_magnet(cell: Cell) -> None:
    """Also where the fourth digit of a share of shear is a 5."""
    pad, force_n = CastMechanics(cell.ramps(sheared=True), 1.0), np.linspace(0.01, 1.4, 30)
    for press in cell.ramps(sheared=True):
        place, shear = ([np.full(30, each) for each in of] for of in (press.place_m, press.shear_share))
        assert (pad.response(*place, force_n, *(force_n * share for share in shear))[:, 2] < 0.0).all()
