"""What MuJoCo's contacts press on a pad: place, force and shear, whatever the order of geoms, one or many."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from worlds import RADIUS_M, WEIGHT_N, pad, world

from fmfts_mujoco.boards import built_of
from fmfts_mujoco.loads import Presses, Reader, Step, responses
from fmfts_mujoco.places import ModelError, Places
from fmfts_mujoco.stacked import Stacked


def settled(model: mujoco.MjModel, push_n: float = 0.0) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.xfrc_applied[model.body("ball").id, 0] = push_n
    for _ in range(1500):
        mujoco.mj_step(model, data)
    return data


def read(model: mujoco.MjModel, data: mujoco.MjData, name: str = "left") -> Step:
    return Reader(model, Places.of(model, [pad(name)])).read(data, 0.0)


def test_ball_presses_with_its_weight_where_it_lies() -> None:
    model = world((4e-3, -3e-3))
    presses = Presses.of([read(model, settled(model))])
    assert presses.load[:, 2].sum() == pytest.approx(WEIGHT_N, rel=1e-3)
    np.testing.assert_allclose(presses.load[0, :2], [4e-3, -3e-3], atol=1e-5)
    np.testing.assert_allclose(presses.load[:, 3:], 0.0, atol=1e-3)


def test_push_is_shear_along_x() -> None:
    model = world()
    presses = Presses.of([read(model, settled(model, push_n=0.2))])
    np.testing.assert_allclose(presses.load[0, 3:], [0.2, 0.0], atol=2e-3)


def test_order_of_the_geoms_does_not_matter() -> None:
    """Here the ball is the first body, and there the last: MuJoCo tells the force of the other one."""
    ball = f'<body name="ball" pos="0 0 0.0289"><freejoint/><geom type="sphere" size="{RADIUS_M}" mass="0.08"/></body>'
    board = '<body><geom type="box" size="0.02 0.02 0.006" pos="0 0 0.008"/><site name="left"/></body>'
    loads = []
    for bodies in (ball + board, board + ball):
        model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
        loads.append(Presses.of([read(model, settled(model))]).load)
    np.testing.assert_allclose(loads[0], loads[1], atol=1e-6)
    assert loads[0][0, 2] == pytest.approx(WEIGHT_N, rel=1e-3)


def test_turned_pad_reports_in_its_own_axes() -> None:
    """The whole world turned by 90° about x, gravity with it: the pad notices nothing."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 9.81 0"/><worldbody><body euler="90 0 0">
        <geom type="box" size="0.02 0.02 0.006" pos="0 0 0.008"/><site name="left"/></body>
        <body name="ball" pos="0.004 -0.0289 -0.003"><freejoint/>
        <geom type="sphere" size="{RADIUS_M}" mass="0.08"/></body>
        </worldbody></mujoco>"""
    )
    presses = Presses.of([read(model, settled(model))])
    np.testing.assert_allclose(presses.load[0, :3], [4e-3, -3e-3, WEIGHT_N], atol=2e-3)


def test_box_geom_is_a_pad_too() -> None:
    model = world((4e-3, -3e-3))
    step = read(model, settled(model), "left_silicone")
    np.testing.assert_allclose(step.origin_m[0], 0.0, atol=1e-12)  # 14 mm below its top, like the site
    assert Presses.of([step]).load[:, 2].sum() == pytest.approx(WEIGHT_N, rel=1e-3)


def test_missing_pad_in_model_is_an_error() -> None:
    with pytest.raises(ModelError, match="pad 'right': the model has no site and no geom"):
        Places.of(world(), [pad("right")])


def test_two_halves_at_one_place_are_one_press() -> None:
    built = built_of(pad())
    stacked = Stacked([built])
    one, many = (_step(np.array(forces)) for forces in ([1.0], [0.25, 0.75]))
    expected = built.response(*(np.array([value]) for value in (2e-3, 1e-3, 1.0)))
    for step in (one, many):
        np.testing.assert_allclose(responses([step], stacked)[0], expected, rtol=1e-9)


def _step(forces_n: np.ndarray) -> Step:
    """Contacts at one place of a pad, which is the second geom of each: they push it down."""
    count = len(forces_n)
    frame = np.tile([0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0], (count, 1))
    force = np.zeros((count, 6))
    force[:, 0] = forces_n
    point_m = np.tile([2e-3, 1e-3, 14e-3], (count, 1))
    pads = np.tile([-1, 0], (count, 1))
    return Step(0.0, np.zeros((1, 3)), np.eye(3)[None], np.empty((0, 3)), pads, point_m, frame, force)
