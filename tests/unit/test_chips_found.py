"""What `baseline --turn` reports about chips with wrong rotations or unequal gains."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
from mounted_world import TOLERANCE, World, turned

from fmfts.baseline import make_turn
from fmfts.baseline.chips_found import chips_found
from fmfts.pad import Pad, rotation_from_vector

HAND_PLACED = replace(TOLERANCE, gain=0.05, sensor_rotation_rad=math.radians(1.5), cross_axis=0.002)


def said(pad: Pad, rotation_deg: tuple[float, float, float], gain: float) -> str:
    """A pad as drawn, except for its third chip's rotation and its second chip's gain."""
    world = World(pad, np.random.default_rng(11))
    world.gain = np.ones((4, 3))
    world.gain[1] += gain
    world.turned[2] = rotation_from_vector(np.radians(rotation_deg))
    return chips_found(make_turn(pad, turned(world), world.baseline(HAND_PLACED))[1])


def test_chip_that_is_turned_is_named_with_angle_and_axis(pad: Pad) -> None:
    found = re.fullmatch(r"sensor 3 is turned by (\d\.\d)° about z", said(pad, (0.0, 0.0, 4.0), 0.0))
    assert found
    # A rotation that all chips share belongs to the robot: of one chip in four, a quarter goes to the others.
    assert 2.5 < float(found[1]) < 4.5


def test_wrong_rotations_and_gains_are_reported(pad: Pad) -> None:
    found = re.fullmatch(
        r"sensor 3 is turned by \d\.\d° about −z; gains are (\d\.\d) % apart", said(pad, (0.0, 0.0, -4.0), 0.04)
    )
    assert found
    # 4 %, and the error that an uneven field leaves in twelve gains: 0.7 % each, of which the largest and the smallest
    # are reported.
    assert 4.0 - 1.0 < float(found[1]) < 4.0 + 2.5


def test_chips_as_drawn_are_not_reported(pad: Pad) -> None:
    assert said(pad, (0.0, 0.0, 0.0), 0.0) == ""
