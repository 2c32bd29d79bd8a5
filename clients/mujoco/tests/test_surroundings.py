"""The Earth's field as a pad turns, a neighbour's magnet, and steel: as closed forms and the daemon say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from fmfts.config import PadConfig, PlacementConfig, SimulatedSource
from fmfts_simulation.finger import no_finger
from fmfts_simulation.neighbour import OneMagnet
from worlds import pad, world

from fmfts_mujoco import Pads
from fmfts_mujoco.boards import NS, built_of
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


def test_message_tells_the_earths_field_while_the_hand_turns() -> None:
    """By 90 degrees in a second: what the pad solves beside its magnet is the world's field in its own axes."""
    hand = (
        '<body pos="1 0 0"><joint name="wrist" axis="1 0 0"/><geom size="0.01" contype="0"/><site name="hand"/></body>'
    )
    model = world(more=hand, magnetic="0.2 0 -0.45")
    data = mujoco.MjData(model)
    pads = Pads(model, data, [pad("hand")])
    for step in range(1000):
        data.joint("wrist").qpos[0] = np.pi / 2.0 * step / 1000.0
        data.joint("wrist").qvel[0] = np.pi / 2.0
        mujoco.mj_step(model, data)
        pads.step(data)
        for told in pads.contacts()["hand"] if step % 100 == 99 else ():
            assert told.health == "ok"
            assert told.contact is False
            angle = np.pi / 2.0 * ((told.t_sample_ns - NS) * 1e-9)
            there_t = np.array([0.2e-4, -0.45e-4 * np.sin(angle), -0.45e-4 * np.cos(angle)])
            # Chips turned by 1.5 degrees and gains off by 0.5 %, of 50 µT; and 0.4 µT of noise.
            np.testing.assert_allclose(told.pose.ambient_t, there_t, atol=3e-6)


def test_neighbour_is_felt_as_in_the_daemons_simulation() -> None:
    field_t = around(world(more=BESIDE, magnetic="0 0 0"), "left", "right")
    left, right = (built_of(pad(name, seed=number)) for number, name in enumerate(("left", "right")))
    there = PlacementConfig(position_mm=(45.0, 10.0, 2.0), rotation_deg=(0.0, 30.0, 0.0)).si()
    felt = OneMagnet(right, there, 0.0, no_finger).field(left.pad.sensors.position_m, np.zeros(4), 0.0)
    assert np.abs(felt).max() > 5e-6
    np.testing.assert_allclose(field_t[0], felt, rtol=1e-6)
    back = OneMagnet(left, PlacementConfig().si().seen_from(there), 0.0, no_finger)
    np.testing.assert_allclose(field_t[1], back.field(right.pad.sensors.position_m, np.zeros(4), 0.0), rtol=1e-6)


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
    # Two dipoles: the pad's magnet and the Earth magnetise the ball, whose field comes back to the chips.
    built, ball_m = built_of(pad(seed=0)).pad, np.array([0.0, 0.0, 0.05])
    moment_t_m3 = built.magnet.strength_t_m3 * built.rest_axis
    there_t = np.array([0.2e-4, 0.0, -0.45e-4]) + sphere_field(ball_m, built.rest_position_m, moment_t_m3)
    back_t = sphere_field(built.sensors.position_m, ball_m, 0.01**3 * there_t)
    np.testing.assert_allclose((steel - alone)[0], back_t, rtol=0.01)


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
