"""What `baseline --rest` says of a self-test, --turn and --refine comes true, about."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from mounted_world import World, pressing, turned

from fmfts.baseline import Mounting, accuracy, make_refined, make_turn
from fmfts.baseline.prospects import prospects
from fmfts.config import ToleranceConfig
from fmfts.pad import Pad

SHIPPED = ToleranceConfig().si()


def said_n(mounting: Mounting, pad: Pad) -> dict[str, float]:
    """Step → the deviation of the depth of 1 N that it is said to leave."""
    found = (
        re.match(r"(\S+): sideways ±\d+ µm .* as a force, ±([\d.]+) N .*, without the silicone's stiffness$", one)
        for one in prospects(mounting, pad)
    )
    return {match[1]: float(match[2]) for match in found if match is not None}


@pytest.fixture
def world(pad: Pad) -> World:
    world = World(pad, np.random.default_rng(4))
    world.spoilt(SHIPPED)
    return world


def test_predicted_accuracy_is_reached(world: World, pad: Pad) -> None:
    before = world.baseline(SHIPPED)
    said = said_n(before.mounting(pad), pad)
    reached = {
        "selftest": accuracy(world.baseline(replace(SHIPPED, gain=0.005)).mounting(pad), pad),
        "--turn": accuracy(make_turn(pad, turned(world), before)[1], pad),
        "--refine": accuracy(make_refined(pad, pressing(world), before)[1], pad),
    }
    for step, facts in reached.items():
        # The field's direction and the presses differ from pad to pad: a quarter.
        assert said[step] == pytest.approx(facts["press_1n_force_sd_n"], rel=0.25)


def test_useless_step_is_not_advised(pad: Pad) -> None:
    exact = replace(SHIPPED, gain=0.0, sensor_rotation_rad=0.0, cross_axis=0.0, sensor_position_m=1e-6)
    world = World(pad, np.random.default_rng(4))
    world.gain, world.places = np.ones((4, 3)), pad.sensors.position_m
    assert prospects(world.baseline(exact).mounting(pad), pad) == []
