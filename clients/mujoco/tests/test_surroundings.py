"""The Earth's field as a pad turns, a neighbour's magnet, and steel: as closed forms and the daemon say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from fmfts.config import PadConfig, PlacementConfig, SimulatedSource
from fmfts.simulation.finger import no_finger
from fmfts.simulation.neighbour import OneMagnet
from worlds import pad, world

from fmfts_mujoco.boards import built_of
from fmfts_mujoco.loads import Reader
from fmfts_mujoco.places import ModelError, Places, volume_m3
from fmfts_mujoco.stacked import Stacked
from fmfts_mujoco.surroundings import Surroundings, sphere_field

BESIDE = '<body pos="0.045 0.01 0.002" euler="0 30 0"><geom type="box" size=".02 .02 .006"/><site name="right"/></body>'


def around(model: mujoco.MjModel, *names: str) -> np.ndarray:
    pads = [pad(name, seed=number) for number, name in enumerate(names)]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    places, stacked = Places.of(model, pads), Stacked([built_of(each) for each in pads])
    return Surroundings(model, places, stacked).field(Reader(model, places).read(data, 0.0), np.zeros((len(pads), 5)))


def test_field_is_that_of_the_model_in_gauss() -> None:
    np.testing.assert_allclose(around(world(magnetic="0.1 0.2 -0.4"), "left")[0], [[1e-5, 2e-5, -4e-5]] * 4, atol=1e-12)


def test_turned_pad_feels_the_field_turned_back() -> None:
    """A quarter turn about x: the world's -z is the pad's -y."""
    turned = '<body euler="90 0 0" pos="1 0 0"><geom size="0.01"/><site name="other"/></body>'
    np.testing.assert_allclose(
        around(world(more=turned, magnetic="0 0 -0.4"), "other")[0, 0], [0.0, -4e-5, 0.0], atol=1e-12
    )


def test_neighbour_is_felt_as_in_the_daemons_simulation() -> None:
    field_t = around(world(more=BESIDE, magnetic="0 0 0"), "left", "right")
    left, right = (built_of(pad(name, seed=number)) for number, name in enumerate(("left", "right")))
    there = PlacementConfig(position_mm=(45.0, 10.0, 2.0), rotation_deg=(0.0, 30.0, 0.0)).si()
    felt = OneMagnet(right, there, 0.0, no_finger).field(left.pad.sensors.position_m, np.zeros(4), 0.0)
    assert np.abs(felt).max() > 5e-6
    np.testing.assert_allclose(field_t[0], felt, rtol=1e-6)


def test_steel_ball_on_the_axis_of_a_field() -> None:
    """Above the pole of a ball of µ ≫ 1 in B, the field grows by 2 B (a/r)³; beside it, it shrinks by B (a/r)³."""
    above, beside = (
        sphere_field(np.array(place_m), np.zeros(3), np.array([0.0, 0.0, 1e-3**3 * 5e-5]))
        for place_m in ([0.0, 0.0, 2e-3], [2e-3, 0.0, 0.0])
    )
    np.testing.assert_allclose(above, [0.0, 0.0, 2 * 5e-5 / 8], rtol=1e-12)
    np.testing.assert_allclose(beside, [0.0, 0.0, -5e-5 / 8], rtol=1e-12)


def test_geom_of_steel_is_felt_and_another_is_not() -> None:
    ball = '<geom type="sphere" size="0.01" pos="0 0 0.05" {0}/>'
    plain, steel = (around(world(more=ball.format(what)), "left") for what in ("", 'material="steel"'))
    alone = around(world(), "left")
    np.testing.assert_array_equal(plain, alone)
    # Of the pad's magnet at 38 mm, and the Earth: 2 B_T/r³ = 22 µT there, of which (1/5)³·2 comes back to the chips.
    assert 1e-7 < np.abs(steel - alone).max() < 2e-6


@pytest.mark.parametrize(
    ("geom", "volume"),
    [
        ('type="sphere" size="0.01"', 4 / 3 * np.pi * 1e-6),
        ('type="box" size="0.01 0.02 0.03"', 8 * 6e-6),
        ('type="cylinder" size="0.01 0.02"', np.pi * 1e-4 * 0.04),
        ('type="capsule" size="0.01 0.02"', np.pi * 1e-4 * 0.04 + 4 / 3 * np.pi * 1e-6),
        ('type="ellipsoid" size="0.01 0.02 0.03"', 4 / 3 * np.pi * 6e-6),
    ],
)
def test_volume(geom: str, volume: float) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><geom {geom}/></worldbody></mujoco>")
    assert volume_m3(model, 0) == pytest.approx(volume)


def test_plane_of_steel_is_refused() -> None:
    model = world(more='<geom type="plane" size="1 1 1" material="steel"/>')
    with pytest.raises(ModelError, match="plane of steel"):
        Places.of(model, [PadConfig(name="left", source=SimulatedSource())])
