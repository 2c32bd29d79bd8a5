"""The models that the package brings: MuJoCo reads them, and MJCF and URDF agree."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from fmfts_simulation.imperfections import TOP_M
from worlds import pad

import fmfts_mujoco
from fmfts_mujoco.places import Places

MODELS = Path(fmfts_mujoco.__file__).parent / "models"
HARDWARE = Path(__file__).parents[3] / "hardware"


def model(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(MODELS / name))


@pytest.mark.parametrize(("name", "site"), [("standard_pad.xml", "pad"), ("fingertip.xml", "tip_pad")])
def test_pad_has_its_site_14_mm_below_its_top(name: str, site: str) -> None:
    one = model(name)
    data = mujoco.MjData(one)
    mujoco.mj_forward(one, data)
    places = Places.of(one, [pad(site)])
    origin_m, turn = places.poses(data)
    silicone = [number for number in np.flatnonzero(places.pad_of_geom == 0) if "silicone" in one.geom(number).name]
    top_m = data.geom_xpos[silicone[0]] + turn[0, :, 2] * one.geom_size[silicone[0], 2]
    rest_m = pad().magnet.rest_mm[2] * 1e-3
    np.testing.assert_allclose(top_m - origin_m[0], turn[0, :, 2] * (rest_m + TOP_M), atol=1e-9)


def test_urdf_of_the_fingertip_has_the_pad_where_mjcf_has_it() -> None:
    urdf, mjcf = model("fingertip.urdf"), model("fingertip.xml")
    poses = []
    for one in (urdf, mjcf):
        data = mujoco.MjData(one)
        data.qpos[0] = 0.3
        mujoco.mj_forward(one, data)
        poses.append(data)
    assert urdf.nq == mjcf.nq == 1
    np.testing.assert_allclose(urdf.jnt_range, mjcf.jnt_range, atol=1e-6)
    # MuJoCo merges links of fixed joints of a URDF: the pad's box is the last of its collision geoms.
    box_m = poses[0].geom_xpos[-1]
    site = mjcf.site("tip_pad").id
    place_m, turn = poses[1].site_xpos[site], poses[1].site_xmat[site].reshape(3, 3)
    np.testing.assert_allclose(box_m, place_m + 7e-3 * turn[:, 2], atol=1e-4)


def test_urdf_of_the_pad_is_read() -> None:
    one = model("standard_pad.urdf")
    np.testing.assert_allclose(one.geom_size[0], [0.02, 0.02, 0.007])


def test_gripper_has_a_pad_on_each_finger() -> None:
    one = model("gripper.xml")
    data = mujoco.MjData(one)
    mujoco.mj_forward(one, data)
    origin_m, turn = Places.of(one, [pad("left_pad"), pad("right_pad")]).poses(data)
    np.testing.assert_allclose(turn[:, :, 2], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(origin_m[:, 0], [-0.044, 0.044])


@pytest.mark.parametrize("hand", ["leap", "allegro"])
def test_printed_fingertip_has_pad_at_same_place_in_urdf_and_mjcf(hand: str) -> None:
    urdf, mjcf = (mujoco.MjModel.from_xml_path(str(HARDWARE / f"fingertip-{hand}.{kind}")) for kind in ("urdf", "xml"))
    data = mujoco.MjData(mjcf)
    mujoco.mj_forward(mjcf, data)
    site = mjcf.site("tip_pad").id
    # MuJoCo merges links of fixed joints of a URDF: the silicone is the last of its collision geoms, 4 mm thick.
    silicone_m = data.site_xpos[site] + 12e-3 * data.site_xmat[site].reshape(3, 3)[:, 2]
    np.testing.assert_allclose(urdf.geom_pos[-1], silicone_m, atol=1e-6)
    assert urdf.geom_size[-1, 2] == pytest.approx(2e-3)
    np.testing.assert_allclose(mjcf.body_subtreemass[1], mass_of(hand), atol=1e-6)


def mass_of(hand: str) -> float:
    """The mass of all links of the URDF."""
    masses = ElementTree.parse(HARDWARE / f"fingertip-{hand}.urdf").getroot().iterfind("link/inertial/mass")
    return sum(float(mass.get("value", "")) for mass in masses)
