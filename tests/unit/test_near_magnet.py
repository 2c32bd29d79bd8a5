"""A magnet so near its sensors that a dipole does not describe it: every stage counts with its octupole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.baseline import Recording, make_bare, make_rest
from fmfts.config import MagnetConfig, PadConfig, SceneConfig, SimulatedSource
from fmfts.pad import Magnet
from fmfts.pose import FREE_PAPER, solve
from fmfts_simulation.cylinder import cylinder_field

# Of weak ferrite: neodymium of this size would saturate the chips' widest range tenfold.
FERRITE = MagnetConfig(diameter_mm=6.0, length_mm=6.0, remanence_t=0.1, rest_mm=(0, 0, 6))


def near() -> PadConfig:
    source = SimulatedSource(seed=2, range_gauss=8.1, turning_deg_per_s=0.0)
    scene = SceneConfig(ambient="constant")
    return PadConfig(name="near", source=source, magnet=FERRITE, scene=scene)


def test_magnet_is_cylinder_only_where_its_octupole_could_be_detected() -> None:
    assert near().pad().magnet.as_cylinder
    weak = PadConfig(name="weak", source=SimulatedSource(), magnet=MagnetConfig(remanence_t=0.3))
    assert not weak.pad().magnet.as_cylinder
    # L/D = √3/2 has no octupole, however near it is.
    assert not Magnet(6e-3, 6e-3 * np.sqrt(3.0) / 2.0, 1.2).seen_from(5e-3).as_cylinder


def test_octupole_on_the_axis_is_what_the_rule_compares() -> None:
    magnet, away = near().pad().magnet, np.array([[0.0, 0.0, 60e-3]])
    exact = cylinder_field(away, np.zeros(3), np.array([0.0, 0.0, 1.0]), magnet)[0, 2]
    dipole = 2.0 * magnet.strength_t_m3 / 60e-3**3
    # The next term is smaller by a few times (3 mm/60 mm)².
    assert exact - dipole == pytest.approx(4.0 * magnet.strength_t_m3 * magnet.octupole_m2 / 60e-3**5, rel=0.03)


def test_term_after_the_octupole_has_the_stated_size() -> None:
    magnet, away_m = near().pad().magnet, 40e-3
    exact = cylinder_field(np.array([[0.0, 0.0, away_m]]), np.zeros(3), np.array([0.0, 0.0, 1.0]), magnet)[0, 2]
    known = magnet.strength_t_m3 * (2.0 / away_m**3 + 4.0 * magnet.octupole_m2 / away_m**5)
    # The seventh moment's share is smaller by a few times (3 mm/40 mm)².
    assert abs(exact - known) == pytest.approx(magnet.beyond_octupole_t(away_m), rel=0.05)


def test_baseline_and_solver_place_a_near_magnet_where_it_is() -> None:
    """The change from rest that a dipole finds is 43 µm off, the next term leaves 11."""
    pad = near().pad()
    change, axis = np.array([3e-4, -2e-4, -5e-4]), np.array([0.06, 0.08, np.sqrt(0.99)])
    tolerance = near().tolerance.si()

    def off_m(as_cylinder: bool) -> float:
        drawn = replace(pad, magnet=replace(pad.magnet, as_cylinder=as_cylinder))
        place = drawn.sensors.position_m
        fields = [
            np.zeros(place.shape),
            cylinder_field(place, drawn.rest_position_m, drawn.rest_axis, drawn.magnet),
            cylinder_field(place, drawn.rest_position_m + change, axis, drawn.magnet),
        ]
        bare, rest = (
            Recording(field, np.full(field.shape, 2e-7), np.full(len(field), 660), 3, 25.0, 3.0) for field in fields[:2]
        )
        _, mounting = make_rest(drawn, tolerance, rest, make_bare(drawn, tolerance, bare))
        found = solve(mounting.magnet_field(fields[2]), mounting.mounted(drawn), mounting.rest, free=FREE_PAPER)
        return float(np.linalg.norm(found.position_m - mounting.rest.position_m - change))

    # The terms after the octupole remain: (3 mm/13 mm)² times a few of it.
    assert off_m(True) < 0.33 * off_m(False)
    assert off_m(False) > 30e-6
