"""Models for the tests: pads on a table, and a ball that presses one."""

from __future__ import annotations

from functools import cache

import mujoco
from fmfts.config import PadConfig, SimulatedSource

from fmfts_mujoco import Pads

BALL_KG, RADIUS_M = 0.08, 0.015
WEIGHT_N = BALL_KG * 9.81
SILICONE = '<geom name="{name}_silicone" type="box" size="0.02 0.02 0.006" pos="0 0 0.008"/>'


def world(
    place_m: tuple[float, float] = (0.0, 0.0), *, more: str = "", magnetic: str = "0.2 0 -0.45"
) -> mujoco.MjModel:
    """A pad "left", and a ball that lies on it at `place_m`, and slides along z and x."""
    x_m, y_m = place_m
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.001" magnetic="{magnetic}"/>
        <asset><material name="steel"/></asset>
        <worldbody>
          <body name="board">{SILICONE.format(name="left")}<site name="left"/></body>
          <body name="ball" pos="{x_m} {y_m} 0.0289">
            <joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>
            <geom type="sphere" size="{RADIUS_M}" mass="{BALL_KG}" friction="0.6"/></body>
          {more}
        </worldbody></mujoco>"""
    )


def pad(name: str = "left", **source: object) -> PadConfig:
    return PadConfig(name=name, source=SimulatedSource(**source))  # type: ignore[arg-type]


def run(model: mujoco.MjModel, data: mujoco.MjData, pads: Pads, seconds: float) -> None:
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        pads.step(data)


@cache
def pressed() -> tuple[mujoco.MjModel, mujoco.MjData, Pads]:
    """The ball on the pad "left", 4 mm to the right; its boards are switched on anew by whoever wants it."""
    model = world((4e-3, -3e-3))
    data = mujoco.MjData(model)
    return model, data, Pads(model, data, [pad()])
